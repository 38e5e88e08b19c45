//! What makes the application's thread keep its cycle (manual 13.9 and 15.5.2, step 7).
//!
//! [`RealTimeConfig`] asks the system for what such a thread needs, [`CycleTimer`] waits for the
//! points of the cycle grid, [`CycleStatistics`] tells how well it was kept.

mod cycle_statistics;
mod cycle_timer;
mod privileges;
mod real_time_config;
mod report;

pub use cycle_statistics::{CycleStatistics, Distribution};
pub use cycle_timer::{CycleStart, CycleTimer, CycleTiming, MAX_SPIN_NS, OverrunPolicy};
pub use real_time_config::{MAX_STACK_PREFAULT_BYTES, Need, RealTimeConfig, RealTimeFault};
pub use report::{Privilege, PrivilegeError, PrivilegeOutcome, RealTimeError, RealTimeReport};
