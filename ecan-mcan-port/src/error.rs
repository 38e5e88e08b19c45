//! What can go wrong outside the cycle.

use ecan_host::{CycleError, Faults};
use thiserror::Error;

use crate::config_check::PortConfigFault;
use crate::session::Session;

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
    /// A gateway is in OP but was not taken into service in time.
    #[error("slave {slave} is {session} after {waited_ms} ms")]
    NotInService {
        /// Slave index.
        slave: usize,
        /// How its session stands.
        session: Session,
        /// How long was waited, in milliseconds.
        waited_ms: u64,
    },
}
