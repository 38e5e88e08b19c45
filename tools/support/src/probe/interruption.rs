//! Reasons for which an experiment ends without a decision.

use std::fmt;

use ecan_host::{CycleError, Error};

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
                let al_status = report.slaves.iter().find_map(|it| it.al_status_code);
                Self::NotInOp { reason: report.to_string(), al_status: al_status.map(|it| it.0) }
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
