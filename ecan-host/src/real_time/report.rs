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
                f.write_str(if cpus.len() == 1 { "CPU " } else { "CPUs " })?;
                write!(f, "{}", List(cpus))
            }
            Self::WakeUpLatency { latency_us } => {
                write!(f, "processors that wake up within {latency_us} us")
            }
            Self::Priority { priority } => write!(f, "SCHED_FIFO priority {priority}"),
        }
    }
}

/// Numbers with commas between them.
pub(super) struct List<'a>(pub(super) &'a [usize]);

impl fmt::Display for List<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (nth, number) in self.0.iter().enumerate() {
            write!(f, "{}{number}", if nth == 0 { "" } else { ", " })?;
        }
        Ok(())
    }
}

/// Why a privilege was not granted.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PrivilegeError {
    /// Cause.
    pub cause: String,
    /// Remedy.
    pub remedy: String,
}

impl fmt::Display for PrivilegeError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}; {}", self.cause, self.remedy)
    }
}

/// Result of one requested privilege.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PrivilegeOutcome {
    /// Requested privilege.
    pub privilege: Privilege,
    /// Whether it is needed.
    pub need: Need,
    /// Why it was not granted; `None` if it was.
    pub refusal: Option<PrivilegeError>,
}

impl PrivilegeOutcome {
    /// Whether it was granted.
    pub fn is_granted(&self) -> bool {
        self.refusal.is_none()
    }
}

impl fmt::Display for PrivilegeOutcome {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.refusal {
            None => write!(f, "{}: done", self.privilege),
            Some(refusal) => write!(f, "{}: not granted, {refusal}", self.privilege),
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
    /// Whether every requested privilege was granted.
    pub fn is_complete(&self) -> bool {
        self.outcomes.iter().all(PrivilegeOutcome::is_granted)
    }

    /// Whether everything required was granted.
    pub fn is_sufficient(&self) -> bool {
        self.outcomes.iter().all(|o| o.is_granted() || o.need == Need::Optional)
    }
}

impl fmt::Display for RealTimeReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (nth, outcome) in self.outcomes.iter().enumerate() {
            write!(f, "{}{outcome}", if nth == 0 { "" } else { "\n" })?;
        }
        Ok(())
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
    #[error("no real-time thread: {}", Missing(.0))]
    Missing(RealTimeReport),
}

/// Required privileges that a report lacks.
struct Missing<'a>(&'a RealTimeReport);

impl fmt::Display for Missing<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let is_missing = |o: &&PrivilegeOutcome| !o.is_granted() && o.need == Need::Required;
        for (nth, outcome) in self.0.outcomes.iter().filter(is_missing).enumerate() {
            write!(f, "{}{outcome}", if nth == 0 { "" } else { "\n" })?;
        }
        Ok(())
    }
}
