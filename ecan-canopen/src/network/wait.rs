//! Execution of the cycle until an event.

use std::time::Duration;

use ecan_host::CycleError;
use ecan_mcan_port::{Cycle, Port};

use super::error::WaitError;

/// Runs the cycle of a Port until `step` returns a value. `step` receives each cycle and the time
/// of the bus clock at its start, in nanoseconds.
///
/// Blocks. Keeps the deadlines of [`Port::wait_next_cycle`], with which the caller continues.
/// Errors of single cycles do not end it; such a cycle has received nothing.
///
/// # Errors
/// - [`WaitError::TimedOut`] after `timeout` by the bus clock, or [`WaitError::Cycle`] if the last
///   cycle failed.
/// - [`WaitError::Cycle`] at once if the bus is not active.
/// - [`WaitError::Stopped`] if the application cancels
///   ([`Adapter::stop_waiting_when`](ecan_host::Adapter::stop_waiting_when)).
pub fn run_cycle_until<T>(
    port: &mut Port,
    timeout: Duration,
    step: impl FnMut(&mut Cycle<'_>, u64) -> Option<T>,
) -> Result<T, WaitError> {
    run(port, timeout, true, step)
}

/// As [`run_cycle_until`], but ignores the application's request to stop waiting: for a shutdown
/// that must complete.
///
/// # Errors
/// [`WaitError::TimedOut`] or [`WaitError::Cycle`], as [`run_cycle_until`].
pub fn run_cycle_uninterrupted<T>(
    port: &mut Port,
    timeout: Duration,
    step: impl FnMut(&mut Cycle<'_>, u64) -> Option<T>,
) -> Result<T, WaitError> {
    run(port, timeout, false, step)
}

fn run<T>(
    port: &mut Port,
    timeout: Duration,
    may_stop: bool,
    mut step: impl FnMut(&mut Cycle<'_>, u64) -> Option<T>,
) -> Result<T, WaitError> {
    let clock = port.adapter().ecrt().clock().clone();
    let start_ns = clock.now_ns();
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
        let waited = Duration::from_nanos(now_ns.saturating_sub(start_ns));
        if waited > timeout {
            return Err(error.map_or(WaitError::TimedOut { waited }, WaitError::from));
        }
    }
}
