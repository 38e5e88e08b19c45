//! The plan of a program, and its Sync0 shift (manual 15.6.1, 16.1).

use std::error::Error;
use std::time::Duration;

use ecan_host::{AdapterConfig, DcSync, Faults, Plan};
use ecan_lite::plan_table;
use ecan_mcan_port::{FrameStream, PortConfig, PortPlan};
use ecan_tool_support::command_line::screen::{Stream, print};
use ecan_tool_support::{print_error_line, print_line};

/// Sync0 with this period; without a shift in microseconds with that of the plan. The other settings of
/// `adapter` are complete.
pub fn sync0(period: Duration, shift_us: Option<u32>, adapter: &AdapterConfig) -> DcSync {
    let planned = DcSync::planned(period, adapter);
    let given = |us: u32| Duration::from_micros(us.into());
    DcSync { shift: shift_us.map_or(planned.shift, given), ..planned }
}

/// Prints the Sync0 shift, and a warning on standard error if the plan finds it among the arrivals of
/// the outputs. Nothing without Sync0.
pub fn print_sync0(adapter: &AdapterConfig, config: &PortConfig) {
    let Some(dc) = adapter.dc else { return };
    let plan = Plan::with_times(adapter, |slave| config.image_times(slave));
    if let Some(arrivals) = plan.output_arrivals() {
        let shift_ns = dc.shift_ns();
        let (shift, margin) = (f64::from(shift_ns), arrivals.margin_ns(shift_ns) as f64);
        print_line!("Sync0 shift {:.1} us, margin by the plan {:.1} us", shift / 1e3, margin / 1e3);
    }
    if let Some(warning) = config.sync0_warning(adapter) {
        print_error_line!("warning: {warning}");
    }
}

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
