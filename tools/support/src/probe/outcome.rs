//! Results of an experiment: its stage, its verdict, and the reasons for which it ends without one.

use std::fmt;

use ecan_host::{CycleError, Error, MaintenanceError, RegisterServiceError};
use serde::Serialize;

/// Decision about an assumption.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Verdict {
    /// The gateway behaves as assumed.
    Holds,
    /// The gateway behaves otherwise.
    Differs,
    /// The experiment did not decide it.
    Undecided,
}

/// Verdict with the observation that led to it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Outcome {
    /// The decision.
    pub verdict: Verdict,
    /// What was measured, or why nothing was decided.
    pub detail: String,
    /// The behaviour found, in the form in which a scenario file of the simulator selects it; `None` for one that
    /// the simulator does not have.
    pub alternative: Option<String>,
}

impl Outcome {
    pub(crate) fn holds(detail: impl Into<String>) -> Self {
        Self { verdict: Verdict::Holds, detail: detail.into(), alternative: None }
    }

    pub(crate) fn differs(detail: impl Into<String>) -> Self {
        Self { verdict: Verdict::Differs, detail: detail.into(), alternative: None }
    }

    pub(crate) fn undecided(reason: impl Into<String>) -> Self {
        Self { verdict: Verdict::Undecided, detail: reason.into(), alternative: None }
    }

    /// Names the behaviour found.
    pub(crate) fn like(self, alternative: impl ToString) -> Self {
        Self { alternative: Some(alternative.to_string()), ..self }
    }

    /// Holds if `is_met`, else differs.
    pub(crate) fn decided(is_met: bool, detail: impl Into<String>) -> Self {
        if is_met { Self::holds(detail) } else { Self::differs(detail) }
    }
}

/// Stage of the probe, in their order.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Stage {
    /// Reads objects in the present state of the gateway.
    Reading,
    /// Configures the gateway in PREOP; restarts it once.
    PreOp,
    /// Exchanges images without frames in OP.
    Op,
    /// Sends frames in the internal loopback of the CAN controller.
    Loopback,
    /// Sends frames between two wired channels.
    Wired,
}

impl Stage {
    /// Every stage, in order.
    pub const ALL: [Self; 5] = [Self::Reading, Self::PreOp, Self::Op, Self::Loopback, Self::Wired];

    /// Description for people.
    pub fn text(self) -> &'static str {
        match self {
            Self::Reading => "reading",
            Self::PreOp => "configuration in PREOP",
            Self::Op => "OP with empty images",
            Self::Loopback => "loopback inside the controller",
            Self::Wired => "frames between wired channels",
        }
    }
}

/// End of an experiment before its decision.
#[derive(Clone, Debug)]
pub enum Interruption {
    /// The user stops the probe.
    Stopped,
    /// The gateway does not respond, or process data were lost.
    LinkLost,
    /// The gateway does not reach OP.
    NotInOp {
        /// Report of the master.
        reason: String,
        /// AL status code, if the master saw one.
        al_status: Option<u16>,
    },
    /// The experiment cannot run; the reason.
    Unavailable(String),
}

pub(crate) type Result<T = (), E = Interruption> = std::result::Result<T, E>;

impl fmt::Display for Interruption {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Stopped => f.write_str("stopped before the end"),
            Self::LinkLost => f.write_str("process data or the link to the gateway were lost"),
            Self::NotInOp { reason, .. } => write!(f, "OP was not reached: {reason}"),
            Self::Unavailable(reason) => f.write_str(reason),
        }
    }
}

impl From<Error> for Interruption {
    fn from(error: Error) -> Self {
        match error {
            Error::Stopped => Self::Stopped,
            Error::NoSuchSlave { .. } | Error::Sdo { abort_code: None, .. } => Self::LinkLost,
            Error::NotOperational(report) => {
                let al_status = report.slaves.iter().find_map(|slave| slave.al_status_code);
                Self::NotInOp {
                    reason: report.to_string(),
                    al_status: al_status.map(|code| code.0),
                }
            }
            other => Self::Unavailable(other.to_string()),
        }
    }
}

impl From<CycleError> for Interruption {
    fn from(error: CycleError) -> Self {
        Self::Unavailable(error.to_string())
    }
}

pub(crate) fn unavailable<T>(reason: impl Into<String>) -> Result<T> {
    Err(Interruption::Unavailable(reason.into()))
}

impl From<MaintenanceError> for Interruption {
    fn from(error: MaintenanceError) -> Self {
        match error {
            MaintenanceError::Device(error) => error.into(),
            other => Self::Unavailable(other.to_string()),
        }
    }
}

impl From<RegisterServiceError> for Interruption {
    fn from(error: RegisterServiceError) -> Self {
        match error {
            RegisterServiceError::Maintenance(error) => error.into(),
            status => Self::Unavailable(status.to_string()),
        }
    }
}
