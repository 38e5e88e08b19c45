//! Configuration of the real-time thread, as plain data.

use thiserror::Error;

use super::cycle_timer::{CycleTiming, MAX_SPIN_NS};
use crate::config::Faults;

/// Most of the stack that settings may ask to have touched in advance, in bytes: half of what Rust
/// gives a thread.
pub const MAX_STACK_PREFAULT_BYTES: usize = 1024 * 1024;

/// Whether a privilege is optional or required.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Need {
    /// Without it the application continues; the report states that.
    #[default]
    Optional,
    /// Without it [`RealTimeConfig::apply`] fails.
    Required,
}

/// One fault of a [`RealTimeConfig`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum RealTimeFault {
    /// A priority that SCHED_FIFO does not have.
    #[error("real-time priority {priority} is outside 1..99")]
    Priority {
        /// The configured priority.
        priority: u8,
    },
    /// An affinity without a processor.
    #[error("the CPU affinity names no CPU")]
    NoCpus,
    /// More stack than a thread is sure to have.
    #[error("stack prefault of {bytes} bytes is above {MAX_STACK_PREFAULT_BYTES}")]
    StackPrefault {
        /// The configured bytes.
        bytes: usize,
    },
    /// A final spin that only burns the processor.
    #[error("final spin of {spin_ns} ns is above {MAX_SPIN_NS} ns")]
    Spin {
        /// The configured spin, in nanoseconds.
        spin_ns: u64,
    },
}

/// Privileges of the cycle thread (manual 15.5.2, step 7), and the timing of its waits.
///
/// The default requests no privilege.
///
/// ```
/// use ecan_host::{CycleTiming, Need, RealTimeConfig};
///
/// let settings = RealTimeConfig {
///     priority: Some(80),
///     cpus: Some(vec![0]),
///     timing: CycleTiming { spin_ns: 100_000, ..CycleTiming::default() },
///     ..RealTimeConfig::default()
/// };
/// settings.check()?;
/// assert_eq!(settings.priority_need, Need::Optional);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct RealTimeConfig {
    /// SCHED_FIFO with this priority, 1 (lowest) to 99; none leaves the scheduling as it is.
    pub priority: Option<u8>,
    /// Whether the priority is needed.
    pub priority_need: Need,
    /// CPUs that the thread may run on, counted from 0; none leaves the affinity as it is.
    pub cpus: Option<Vec<usize>>,
    /// Whether the affinity is needed.
    pub cpus_need: Need,
    /// Keeps all memory of the process in RAM, present and future, and touches this number of bytes of
    /// the thread's stack in advance, 0 to [`MAX_STACK_PREFAULT_BYTES`]; none locks nothing.
    ///
    /// If RLIMIT_MEMLOCK bounds what may be locked, it bounds what the process can allocate
    /// from then on.
    pub lock_memory: Option<usize>,
    /// Whether locked memory is needed.
    pub lock_memory_need: Need,
    /// Keeps the processors of the machine out of sleep states that take longer than this time
    /// to leave, in microseconds, for as long as the process lives; 0 allows none. It costs power.
    pub wake_up_latency_us: Option<u32>,
    /// Whether the latency is needed.
    pub wake_up_latency_need: Need,
    /// Timing of the wait for the next cycle, for
    /// [`Adapter::set_cycle_timing`](crate::Adapter::set_cycle_timing) or a
    /// [`CycleTimer`](crate::CycleTimer). [`apply`](Self::apply) only checks it.
    pub timing: CycleTiming,
}

impl RealTimeConfig {
    /// Checks the values, without a request to the system.
    ///
    /// # Errors
    /// Every fault found.
    pub fn check(&self) -> Result<(), Faults<RealTimeFault>> {
        let mut faults = Vec::new();
        if let Some(priority) = self.priority.filter(|p| !(1..=99).contains(p)) {
            faults.push(RealTimeFault::Priority { priority });
        }
        if self.cpus.as_ref().is_some_and(Vec::is_empty) {
            faults.push(RealTimeFault::NoCpus);
        }
        if let Some(bytes) = self.lock_memory.filter(|bytes| *bytes > MAX_STACK_PREFAULT_BYTES) {
            faults.push(RealTimeFault::StackPrefault { bytes });
        }
        let spin_ns = self.timing.spin_ns;
        if spin_ns > MAX_SPIN_NS {
            faults.push(RealTimeFault::Spin { spin_ns });
        }
        Faults::check(faults)
    }
}
