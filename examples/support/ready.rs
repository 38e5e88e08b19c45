//! Waits until the gateways are ready, or until the user stops the program.

use ecan_mcan_port::{Port, PortError};

use crate::interrupt::Interrupt;

/// Waits until all gateways are ready. Returns false if the user stopped the program.
///
/// # Errors
/// A gateway did not become ready in time; the error names it and the reason.
pub fn wait_ready(port: &mut Port, interrupt: &Interrupt) -> Result<bool, PortError> {
    let ready = port.wait_ready_with(port.startup_timeout(), |port| {
        // Single cycles may fail; the timeout ends the wait.
        port.begin_cycle().finish();
        if interrupt.is_set() { Err(Stop::Interrupted) } else { Ok(()) }
    });
    match ready {
        Ok(()) => Ok(true),
        Err(Stop::Interrupted) => Ok(false),
        Err(Stop::Failed(error)) => Err(error),
    }
}

enum Stop {
    Interrupted,
    Failed(PortError),
}

impl From<PortError> for Stop {
    fn from(error: PortError) -> Self {
        Self::Failed(error)
    }
}
