//! Real-time thread of the cycle (manual 13.9 and 15.5.2, step 7).
//!
//! [`RealTimeConfig`] requests the privileges of such a thread, [`CycleTimer`] waits for the
//! deadlines, [`CycleStatistics`] measures the cycles.

mod cycle_statistics;
mod cycle_timer;
mod privileges;
mod real_time_config;
mod report;

pub use cycle_statistics::{CycleStatistics, Distribution};
pub(crate) use cycle_timer::TimerWait;
pub use cycle_timer::{CycleStart, CycleTimer, CycleTiming, MAX_SPIN_NS, OverrunPolicy};
pub use real_time_config::{MAX_STACK_PREFAULT_BYTES, Need, RealTimeConfig, RealTimeFault};
pub(crate) use report::join;
pub use report::{Privilege, PrivilegeError, PrivilegeOutcome, RealTimeError, RealTimeReport};
