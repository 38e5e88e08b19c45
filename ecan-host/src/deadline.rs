//! Deadlines of blocking waits.

use std::time::Duration;

use ecrt_sys::Clock;

/// The time `timeout` from now on `clock`, in nanoseconds.
pub(crate) fn deadline_ns(clock: &dyn Clock, timeout: Duration) -> u64 {
    let timeout_ns = u64::try_from(timeout.as_nanos()).unwrap_or(u64::MAX);
    clock.now_ns().saturating_add(timeout_ns)
}
