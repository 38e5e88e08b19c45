//! Scheduling of the service's threads.

use rustix::thread::{CpuSet, sched_getaffinity, sched_setaffinity};

/// Leaves the real-time scheduling of the thread that started this one, and its CPUs if other ones are
/// left.
pub(crate) fn enter_background() {
    match ecan_host::leave_real_time() {
        Ok(true) => {}
        Ok(false) => return,
        Err(error) => return tracing::warn!("service: cannot leave real-time scheduling: {error}"),
    }
    // The real-time thread may be bound to CPUs of its own.
    let Ok(bound) = sched_getaffinity(None) else { return };
    let mut others = CpuSet::new();
    for cpu in 0..CpuSet::MAX_CPU {
        if !bound.is_set(cpu) {
            others.set(cpu);
        }
    }
    // Fails if there is no other CPU.
    let _ = sched_setaffinity(None, &others);
}
