//! Startup of the slaves: steps that the Adapter executes in PREOP.

mod startup_plan;
mod startup_step;

pub use startup_plan::StartupPlan;
pub(crate) use startup_plan::run_steps;
pub use startup_step::{Expectation, StartupStep};
