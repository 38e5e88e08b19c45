//! Errors of the Port outside the cycle.

use ecan_host::{CycleError, Faults};
use thiserror::Error;

use crate::address::AddressError;
use crate::config_check::PortConfigFault;
use crate::session::machine::Session;
use crate::session::verification::{PendingStep, VerificationFault};

/// Errors of the Port outside the cycle.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum PortError {
    /// The configuration has faults; nothing was touched.
    #[error(transparent)]
    Config(#[from] Faults<PortConfigFault>),
    /// The Adapter failed.
    #[error(transparent)]
    Adapter(#[from] ecan_host::Error),
    /// The cycle failed while waiting.
    #[error(transparent)]
    Cycle(#[from] CycleError),
    /// The Port does not have this address.
    #[error(transparent)]
    Address(#[from] AddressError),
    /// A gateway is in OP but not ready in time.
    #[error(
        "slave {slave} is {session} after {waited_ms} ms{}",
        details(*session, *waiting_for, *last_fault)
    )]
    NotReady {
        /// Slave index.
        slave: usize,
        /// State of its session.
        session: Session,
        /// Step that it waits for; `None` if its verification fails by a value that does not change.
        waiting_for: Option<PendingStep>,
        /// Fault of its last verification that failed.
        last_fault: Option<VerificationFault>,
        /// Time waited, in milliseconds.
        waited_ms: u64,
    },
}

impl PortError {
    /// Returns whether the cause may pass by itself, so that the same call can succeed later.
    pub fn is_temporary(&self) -> bool {
        match self {
            Self::NotReady { last_fault, .. } => {
                !matches!(last_fault, Some(VerificationFault::NodeMode { .. }))
            }
            Self::Adapter(error) => error.is_temporary(),
            Self::Cycle(error) => error.is_temporary(),
            _ => false,
        }
    }
}

/// Step that a gateway waits for, and the last fault unless the session contains it.
fn details(
    session: Session,
    waiting_for: Option<PendingStep>,
    last_fault: Option<VerificationFault>,
) -> String {
    let mut text = waiting_for.map_or_else(String::new, |step| format!("; it waits for {step}"));
    if let Some(fault) = last_fault
        && session != Session::Failed(fault)
    {
        text.push_str(&format!("; the last attempt failed: {fault}"));
    }
    text
}
