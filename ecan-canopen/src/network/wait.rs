//! Running the cycle until something has happened.

use ecan_host::CycleError;
use ecan_mcan_port::{Cycle, Port};

use super::error::WaitError;
use super::heartbeat::NS_PER_MS;

/// Runs the cycle of a Port until `step` returns a value; `step` gets each cycle and the time of the
/// bus clock at its begin.
///
/// Blocks. Keeps the grid of [`Port::wait_next_cycle`], with which the caller goes on. Errors of
/// single cycles do not end it; the step then finds nothing received.
///
/// # Errors
/// [`WaitError::Stopped`] where the application gives up; [`WaitError::TimedOut`] after `timeout_ms` milliseconds of the bus clock; [`WaitError::Cycle`]
/// instead where the last cycle failed, and at once where the bus is not active.
pub fn run_cycle_until<T>(
    port: &mut Port,
    timeout_ms: u32,
    step: impl FnMut(&mut Cycle<'_>, u64) -> Option<T>,
) -> Result<T, WaitError> {
    run(port, timeout_ms, true, step)
}

/// As [`run_cycle_until`], but ignores the application's request to stop waiting: for a shutdown
/// that must complete.
///
/// # Errors
/// [`WaitError::TimedOut`] or [`WaitError::Cycle`], as [`run_cycle_until`].
pub fn run_cycle_uninterrupted<T>(
    port: &mut Port,
    timeout_ms: u32,
    step: impl FnMut(&mut Cycle<'_>, u64) -> Option<T>,
) -> Result<T, WaitError> {
    run(port, timeout_ms, false, step)
}

fn run<T>(
    port: &mut Port,
    timeout_ms: u32,
    may_stop: bool,
    mut step: impl FnMut(&mut Cycle<'_>, u64) -> Option<T>,
) -> Result<T, WaitError> {
    let clock = port.adapter().ecrt().clock().clone();
    let start_ns = clock.now_ns();
    let limit_ns = u64::from(timeout_ms) * NS_PER_MS;
    loop {
        port.wait_next_cycle();
        let now_ns = clock.now_ns();
        let mut cycle = port.begin_cycle();
        let result = step(&mut cycle, now_ns);
        let error = cycle.finish().error();
        if let Some(value) = result {
            return Ok(value);
        }
        if let Some(error @ CycleError::NotActive { .. }) = error {
            return Err(error.into());
        }
        if may_stop && port.adapter().should_stop() {
            return Err(WaitError::Stopped);
        }
        let waited_ns = now_ns.saturating_sub(start_ns);
        if waited_ns > limit_ns {
            let timed_out = WaitError::TimedOut { waited_ms: waited_ns / NS_PER_MS };
            return Err(error.map_or(timed_out, WaitError::from));
        }
    }
}
