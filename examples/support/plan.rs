//! The preflight plan (`--plan`).

use std::error::Error;

use ecan_host::{AdapterConfig, Faults};
use ecan_lite::plan_table;
use ecan_mcan_port::{FrameStream, PortConfig, PortPlan};
use ecan_tool_support::command_line::screen::{Stream, print};

/// Prints the load of a configuration, with its warnings.
///
/// # Errors
/// Every fault of the plan and of the configuration.
pub fn print_plan(
    adapter: &AdapterConfig,
    config: &PortConfig,
    traffic: &[FrameStream],
) -> Result<(), Box<dyn Error>> {
    let plan = PortPlan::of(adapter, config, traffic);
    print(Stream::Output, plan_table(&plan, adapter, traffic));
    Ok(Faults::check(plan.faults(adapter, config))?)
}
