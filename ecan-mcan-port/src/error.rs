//! What can go wrong outside the cycle.

use ecan_host::{CycleError, Faults};
use thiserror::Error;

use crate::config_check::PortConfigFault;
use crate::phase_sweep::PhaseSweepFault;
use crate::session::{PendingStep, Session};
use crate::verification::VerificationFault;

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
    /// Phases of Sync0 are to be tried, but distributed clocks are not configured.
    #[error("distributed clocks with Sync0 are not configured: there is no phase to be found")]
    NoSync0,
    /// A sweep over phases that cannot be tried; nothing was touched.
    #[error(transparent)]
    PhaseSweep(#[from] PhaseSweepFault),
    /// A gateway is in OP but was not taken into service in time.
    #[error(
        "slave {slave} is {session} after {waited_ms} ms{}",
        details(*session, *waiting_for, *last_fault)
    )]
    NotInService {
        /// Slave index.
        slave: usize,
        /// How its session stands.
        session: Session,
        /// What it waits for.
        waiting_for: Option<PendingStep>,
        /// Why its last attempt failed, if one did.
        last_fault: Option<VerificationFault>,
        /// How long was waited, in milliseconds.
        waited_ms: u64,
    },
}

/// What a gateway waits for and what went wrong before, as far as the session does not say it.
fn details(
    session: Session,
    waiting_for: Option<PendingStep>,
    last_fault: Option<VerificationFault>,
) -> String {
    let mut text = waiting_for.map_or_else(String::new, |it| format!("; it waits for {it}"));
    if let Some(fault) = last_fault
        && session != Session::Failed(fault)
    {
        text.push_str(&format!("; the last attempt failed: {fault}"));
    }
    text
}
