//! The preflight plan (`--plan`): what a configuration costs, and what speaks against it.

use std::error::Error;

use ecan_host::{AdapterConfig, Faults};
use ecan_mcan_port::{FrameStream, PortConfig, PortPlan};

/// Prints the plan with its warnings.
///
/// # Errors
/// Everything that would not work, by the plan or by the check of the configuration.
pub fn print(
    adapter: &AdapterConfig,
    config: &PortConfig,
    traffic: &[FrameStream],
) -> Result<(), Box<dyn Error>> {
    let plan = PortPlan::of(adapter, config, traffic);
    print!("{}", plan.table(adapter, traffic));
    Ok(Faults::check(plan.faults(adapter, config))?)
}
