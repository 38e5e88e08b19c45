//! Diagnosis of a gateway (manual 5.4.6, 16): findings with causes, most likely first, and the next
//! step.
//!
//! The crate does not access a device. [`Snapshot::read`] reads values through a function of the
//! caller; [`findings`] is a pure function of a snapshot, which can also come from a file.
//!
//! ```
//! use ecan_tool_support::diagnosis::{Snapshot, findings};
//!
//! let mut snapshot = Snapshot::default();
//! snapshot.set(0x8010, 2, 5);
//! let found = findings(&snapshot);
//! assert_eq!(found[0].id, "profile-mapping-reload");
//! ```
//!
//! Allocates; do not call in the cycle.

mod channel;
mod channel_setting;
mod gateway;
mod operation;
mod process_data;
pub mod registers;
mod snapshot;

use std::fmt;

pub use gateway::{DIAGNOSTIC_FLAGS, findings, flag_names};
use serde::Serialize;
pub use snapshot::{Depth, ObjectKey, ReadError, Snapshot};

/// Severity of a finding.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Severity {
    /// A function does not work.
    Fault,
    /// Losses, past losses, or a configuration that will fail.
    Warning,
}

/// Location of a finding.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Location {
    /// The gateway as an EtherCAT slave.
    Slave,
    /// TxPDO, process data to the host.
    TxPdo,
    /// RxPDO, process data from the host.
    RxPdo,
    /// A CAN channel, 0 to 3.
    Channel(u8),
    /// Firmware and its configuration.
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

/// Problem with causes and next step.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Finding {
    /// Stable identifier, for programs.
    pub id: &'static str,
    /// Severity.
    pub severity: Severity,
    /// Location.
    pub location: Location,
    /// Description of the problem.
    pub what: String,
    /// Possible causes, the most likely first.
    pub causes: Vec<String>,
    /// Next step.
    pub next: String,
    /// Chapter of the manual.
    pub chapter: &'static str,
}

impl Finding {
    pub(crate) fn fault(id: &'static str, location: Location, what: impl Into<String>) -> Self {
        let (severity, what) = (Severity::Fault, what.into());
        Self {
            id,
            severity,
            location,
            what,
            causes: Vec::new(),
            next: String::new(),
            chapter: "16",
        }
    }

    pub(crate) fn warning(id: &'static str, location: Location, what: impl Into<String>) -> Self {
        Self { severity: Severity::Warning, ..Self::fault(id, location, what) }
    }

    pub(crate) fn causes(mut self, causes: &[&str]) -> Self {
        self.causes.extend(causes.iter().map(|cause| (*cause).to_owned()));
        self
    }

    pub(crate) fn cause(mut self, cause: impl Into<String>) -> Self {
        self.causes.push(cause.into());
        self
    }

    pub(crate) fn cause_if(mut self, cause: Option<String>) -> Self {
        self.causes.extend(cause);
        self
    }

    /// Completes the finding with the next step and the chapter of the manual; `Some`, because the
    /// checks return `None` without a finding.
    pub(crate) fn next_step(self, next: impl Into<String>, chapter: &'static str) -> Option<Self> {
        Some(Self { next: next.into(), chapter, ..self })
    }
}
