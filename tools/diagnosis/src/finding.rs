//! What a finding is.

use std::fmt;

use serde::Serialize;

/// How much a finding matters.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Severity {
    /// Something does not work.
    Fault,
    /// Something works with losses, worked with losses before, or will not work as it stands.
    Warning,
}

/// Where a finding is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Location {
    /// The gateway as an EtherCAT slave.
    Slave,
    /// Process data to the host.
    TxPdo,
    /// Process data from the host.
    RxPdo,
    /// A CAN channel, 0 to 3.
    Channel(u8),
    /// The gateway's firmware and its configuration.
    Device,
}

impl fmt::Display for Location {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Slave => f.write_str("EtherCAT"),
            Self::TxPdo => f.write_str("TxPDO"),
            Self::RxPdo => f.write_str("RxPDO"),
            Self::Channel(channel) => write!(f, "CAN{channel}"),
            Self::Device => f.write_str("device"),
        }
    }
}

/// Something that is amiss, in words.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Finding {
    /// A name that stays, for programs.
    pub id: &'static str,
    /// How much it matters.
    pub severity: Severity,
    /// Where.
    pub place: Location,
    /// What was found.
    pub what: String,
    /// What may be behind it, the most likely cause first.
    pub causes: Vec<String>,
    /// What to do next.
    pub next: String,
    /// The manual's chapter.
    pub chapter: &'static str,
}

impl Finding {
    pub(crate) fn fault(id: &'static str, place: Location, what: impl Into<String>) -> Self {
        Self {
            id,
            severity: Severity::Fault,
            place,
            what: what.into(),
            causes: Vec::new(),
            next: String::new(),
            chapter: "16",
        }
    }

    pub(crate) fn warning(id: &'static str, place: Location, what: impl Into<String>) -> Self {
        Self { severity: Severity::Warning, ..Self::fault(id, place, what) }
    }

    pub(crate) fn because(mut self, causes: &[&str]) -> Self {
        self.causes.extend(causes.iter().map(|cause| (*cause).to_owned()));
        self
    }

    pub(crate) fn or_because(mut self, cause: impl Into<String>) -> Self {
        self.causes.push(cause.into());
        self
    }

    /// A cause that may not be there.
    pub(crate) fn because_of(mut self, cause: Option<String>) -> Self {
        self.causes.extend(cause);
        self
    }

    pub(crate) fn so(mut self, next: impl Into<String>, chapter: &'static str) -> Self {
        self.next = next.into();
        self.chapter = chapter;
        self
    }
}
