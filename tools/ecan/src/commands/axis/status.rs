//! `ecan axis status`: state of a drive, and why it is not enabled.

use std::time::Duration;

use clap::Args;
use ecan_canopen::object;

use crate::commands::node::node_client::{NodeClient, start};
use crate::commands::node::scan_report::state_name;
use crate::context::{Context, Failure, Result};
use crate::frames::FrameOptions;
use crate::via;

use super::axis_choice::{AxisOptions, ChosenAxis};
use super::drive_report::{self, DriveReport};

pub const NOTES: &str = "\
Reads objects of the drive by SDO, and writes none; also through a service (--via). Exit status 1 if
the drive is in fault. With --watch a line is printed for each change, until Ctrl-C or for --for;
with --json an object for each.";

#[derive(Debug, Args)]
pub struct StatusArguments {
    #[command(flatten)]
    axis: AxisOptions,
    /// Print each change of state, error or position
    #[arg(long)]
    watch: bool,
    /// Watch for this time, in s
    #[arg(long = "for", value_name = "SECONDS", requires = "watch",
          value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    seconds: Option<u32>,
    #[command(flatten)]
    options: FrameOptions,
}

const SDO_TIMEOUT: Duration = Duration::from_millis(500);
/// Longest time to wait for a heartbeat.
const MOST_HEARTBEAT_MS: u64 = 3_000;
/// Interval of the live view.
const WATCH: Duration = Duration::from_millis(200);

pub fn run(arguments: &StatusArguments, context: &Context) -> Result {
    let StatusArguments { axis, options, .. } = arguments;
    let file = options.gateway.setup.config.as_deref();
    let chosen = axis.choose(file, false, context)?;
    let context = &chosen.context(context).on_stderr(options.capture.is_on_output());
    let mut options = options.clone();
    if file.is_some() && via::open(context.global, context.global.master())?.is_some() {
        // The service has configured the gateway; the file describes the axis only.
        options.gateway.setup.config = None;
    }
    let has_end = !arguments.watch || arguments.seconds.is_some();
    let link = start(&options, chosen.target.channel, has_end, context)?;
    let client = NodeClient::new(link, chosen.target, SDO_TIMEOUT);
    client.run(|client| {
        let report = read(client, &chosen)?;
        if arguments.watch {
            return watch(client, &chosen, report, arguments, context);
        }
        context.output.data(&report, |out| drive_report::print(&report, out))?;
        if report.has_fault { Err(Failure::ProblemsFound) } else { Ok(()) }
    })
}

fn read(client: &mut NodeClient, chosen: &ChosenAxis) -> Result<DriveReport> {
    // A node without a statusword is not a drive.
    let statusword = chosen.config.object_index(object::STATUSWORD);
    let Some(_) = client.number(statusword, 0)? else {
        return Err(Failure::Rejected(format!(
            "{} has no statusword 0x{statusword:04X}: it is not a drive (CiA 402), or has fewer axes; \
             `ecan node info` shows the node",
            chosen.label
        )));
    };
    let period_ms = client.number(object::PRODUCER_HEARTBEAT, 0)?.unwrap_or(0);
    if period_ms > 0 && client.state().is_none() {
        let time = Duration::from_millis((period_ms * 2 + 100).min(MOST_HEARTBEAT_MS));
        client.run_for(time, |it| it.state().is_some())?;
    }
    let state = client.state().map(state_name);
    DriveReport::read(chosen.label.clone(), chosen.units, state, &mut |index, subindex| {
        client.number(chosen.config.object_index(index), subindex)
    })
}

fn watch(
    client: &mut NodeClient,
    chosen: &ChosenAxis,
    first: DriveReport,
    arguments: &StatusArguments,
    context: &Context,
) -> Result {
    let start_ns = client.link.service.now_ns();
    let mut last = String::new();
    let mut report = first;
    loop {
        let elapsed_ns = client.link.service.now_ns().saturating_sub(start_ns);
        let line = report.line();
        if line != last {
            let seconds = elapsed_ns as f64 / 1e9;
            context.output.data(&report, |out| writeln!(out, "{seconds:.1} s: {line}"))?;
            last = line;
        }
        let most_ns = arguments.seconds.map(|seconds| u64::from(seconds) * 1_000_000_000);
        if most_ns.is_some_and(|most| elapsed_ns >= most) {
            return Ok(());
        }
        let next = client.run_for(WATCH, |_| false).and_then(|_| read(client, chosen));
        report = match next {
            // The user ends it.
            Err(Failure::Incomplete(_)) if client.link.service.is_interrupted() => return Ok(()),
            next => next?,
        };
    }
}
