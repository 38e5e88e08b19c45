//! Report of the privileges of a real-time thread.

use std::fmt;

use thiserror::Error;

use super::real_time_config::{Need, RealTimeFault};
use crate::config::Faults;

/// A privilege that a real-time thread requests from the system.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Privilege {
    /// All memory in RAM, with the stack touched in advance.
    LockedMemory {
        /// Bytes of stack.
        stack_bytes: usize,
    },
    /// Execution on these CPUs only.
    Affinity {
        /// The CPUs, counted from 0.
        cpus: Vec<usize>,
    },
    /// No sleep state of a processor that takes longer to leave.
    WakeUpLatency {
        /// In microseconds.
        latency_us: u32,
    },
    /// SCHED_FIFO.
    Priority {
        /// Its priority, 1 to 99.
        priority: u8,
    },
}

impl fmt::Display for Privilege {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::LockedMemory { stack_bytes } => {
                write!(f, "locked memory with {stack_bytes} bytes of stack")
            }
            Self::Affinity { cpus } => {
                let noun = if cpus.len() == 1 { "CPU" } else { "CPUs" };
                write!(f, "{noun} {}", join(cpus, ", "))
            }
            Self::WakeUpLatency { latency_us } => {
                write!(f, "processors that wake up within {latency_us} us")
            }
            Self::Priority { priority } => write!(f, "SCHED_FIFO priority {priority}"),
        }
    }
}

/// The texts of the items, with a separator between them.
pub(crate) fn join<T: fmt::Display>(items: impl IntoIterator<Item = T>, separator: &str) -> String {
    let texts: Vec<String> = items.into_iter().map(|item| item.to_string()).collect();
    texts.join(separator)
}

/// Error of a privilege that was not granted.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error("{cause}; {remedy}")]
pub struct PrivilegeError {
    /// Cause.
    pub cause: String,
    /// Remedy.
    pub remedy: String,
}

/// Result of one requested privilege.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PrivilegeOutcome {
    /// Requested privilege.
    pub privilege: Privilege,
    /// Whether it is needed.
    pub need: Need,
    /// Error; `None` if it was granted.
    pub denial: Option<PrivilegeError>,
}

impl PrivilegeOutcome {
    /// Returns whether it was granted.
    pub fn is_granted(&self) -> bool {
        self.denial.is_none()
    }
}

impl fmt::Display for PrivilegeOutcome {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.denial {
            None => write!(f, "{}: done", self.privilege),
            Some(denial) => write!(f, "{}: not granted, {denial}", self.privilege),
        }
    }
}

/// Result of every requested privilege, in the order of application. Displays a line for each.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct RealTimeReport {
    /// Requested privileges only.
    pub outcomes: Vec<PrivilegeOutcome>,
}

impl RealTimeReport {
    /// Returns whether every requested privilege was granted.
    pub fn is_complete(&self) -> bool {
        self.outcomes.iter().all(PrivilegeOutcome::is_granted)
    }

    /// Returns whether everything required was granted.
    pub fn is_sufficient(&self) -> bool {
        self.missing().next().is_none()
    }

    fn missing(&self) -> impl Iterator<Item = &PrivilegeOutcome> {
        self.outcomes.iter().filter(|o| !o.is_granted() && o.need == Need::Required)
    }
}

impl fmt::Display for RealTimeReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&join(&self.outcomes, "\n"))
    }
}

/// Error of [`RealTimeConfig::apply`](crate::RealTimeConfig::apply).
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum RealTimeError {
    /// The values are faulty; nothing was applied.
    #[error("real-time settings: {0}")]
    Settings(#[from] Faults<RealTimeFault>),
    /// A required privilege was not granted. The report contains all results.
    #[error("no real-time thread: {}", join(.0.missing(), "\n"))]
    Missing(RealTimeReport),
}
