//! Waits until the gateways are ready, or until the user stops the program.

use ecan_host::Error;
use ecan_mcan_port::{Port, PortError};
use ecan_tool_support::print_line;

use crate::interrupt::Interrupt;

/// Waits until all gateways are ready. Prints a message and returns false if the user stopped the
/// program.
///
/// # Errors
/// A gateway did not become ready in time; the error names it and the reason.
pub fn wait_ready(port: &mut Port, interrupt: &Interrupt) -> Result<bool, PortError> {
    let interrupt = interrupt.clone();
    port.adapter_mut().stop_waiting_when(Some(Box::new(move || interrupt.is_set())));
    let ready = port.wait_ready();
    port.adapter_mut().stop_waiting_when(None);
    if matches!(ready, Err(PortError::Adapter(Error::Stopped))) {
        print_line!("stopped by the user");
        return Ok(false);
    }
    ready.map(|()| true)
}
