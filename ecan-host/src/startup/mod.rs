//! Startup of the slaves: steps that the Adapter executes in PREOP.

mod blocking;
mod startup_plan;
mod startup_step;

pub use startup_plan::StartupPlan;
pub use startup_step::StartupStep;
