//! `ecan plan`: load of a configuration, with warnings.

mod advice;
mod report;
mod traffic;

use std::convert::Infallible;
use std::path::PathBuf;

use clap::Args;
use ecan_host::AdapterConfig;
use ecan_mcan_port::{ChannelConfig, GatewayConfig, PortConfig, PortPlan};
use ecan_tool_support::command_line::options::parse_bit_rate;

use crate::config_file;
use crate::context::{Context, Failure, Result, Tone};
use crate::frames::{Channels, SetupOptions};

use advice::advice;
use report::Report;

/// Default nominal bit rate of a plan in bit/s: the factory setting of a gateway.
const BITRATE: u32 = 500_000;

#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  ecan plan --slaves 3 --channel all
  ecan plan --config cell.toml --frames 4
  ecan plan --bitrate 1M --data-bitrate 5M --pdo-n 8 --channel 0,2
  ecan plan --channel all --replay drive.log

The default bit rate is 500 kbit/s. Exit status 1 if the configuration cannot work. Runs offline.")]
pub struct PlanArguments {
    /// Number of gateways
    #[arg(long, value_name = "N", default_value_t = 1, conflicts_with = "config",
          value_parser = clap::value_parser!(u16).range(1..=64))]
    slaves: u16,
    /// CAN channels of every gateway, 0 to 3, comma-separated, or all [default: 0, or all channels
    /// of the file]
    #[arg(long, value_name = "CHANNELS")]
    channel: Option<Channels>,
    /// Frames per channel and cycle, in each direction
    #[arg(long, value_name = "N", default_value_t = 1)]
    frames: u32,
    /// Data bytes per frame [default: 8, or 64 with CAN FD]
    #[arg(long, value_name = "N")]
    bytes: Option<u8>,
    /// Plan the mean load of a recording instead; several channels: canN of it goes to
    /// channel N, counted over all gateways
    #[arg(long, value_name = "FILE", conflicts_with_all = ["frames", "bytes"])]
    replay: Option<PathBuf>,
    /// Alias of --data-bitrate
    #[arg(long, value_name = "BITRATE", hide = true, value_parser = parse_bit_rate,
          conflicts_with_all = ["data_bitrate", "config"])]
    fd: Option<u32>,
    #[command(flatten)]
    setup: SetupOptions,
}

struct Planned {
    adapter: AdapterConfig,
    port: PortConfig,
    channels: Channels,
}

pub fn run(arguments: &PlanArguments, context: &Context) -> Result {
    context.global.without_service("it computes offline")?;
    let planned = match &arguments.setup.config {
        Some(path) => {
            let file = config_file::read(path)?;
            let channels = arguments.channel.unwrap_or(Channels::ALL);
            Planned { adapter: file.adapter, port: file.port, channels }
        }
        None => of_options(arguments),
    };
    let traffic = traffic::of(arguments, &planned)?;
    let Planned { adapter, port, .. } = planned;
    let plan = PortPlan::of(&adapter, &port, &traffic);
    let faults = plan.faults(&adapter, &port);
    let output = &context.output;
    output.data(&Report::new(&plan, &faults), |out| {
        write!(out, "{}", ecan_lite::plan_table(&plan, &adapter, &traffic))?;
        advice(&plan).iter().try_for_each(|advice| writeln!(out, "note: {advice}"))?;
        faults
            .iter()
            .try_for_each(|fault| writeln!(out, "{} {fault}", output.toned(Tone::Bad, "fault:")))
    })?;
    if faults.is_empty() { Ok(()) } else { Err(Failure::ProblemsFound) }
}

fn of_options(arguments: &PlanArguments) -> Planned {
    let PlanArguments { slaves, fd, .. } = *arguments;
    let mut setup = arguments.setup.clone();
    setup.data_bitrate = setup.data_bitrate.or(fd);
    let otherwise = || Ok::<_, Infallible>(ChannelConfig::classic(BITRATE));
    let Ok(settings) = setup.channel(otherwise);
    let channels = arguments.channel.unwrap_or(Channels::only(0));
    let mut gateway = GatewayConfig::default();
    for (channel, slot) in (0..).zip(&mut gateway.channels) {
        *slot = channels.contains(channel).then_some(settings);
    }
    let port = PortConfig::uniform(slaves.into(), gateway);
    Planned { adapter: setup.adapter(slaves), port, channels }
}
