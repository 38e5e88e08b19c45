//! `ecan plan`: what a configuration costs, and what speaks against it.

mod report;
mod traffic;

use std::convert::Infallible;
use std::path::PathBuf;

use clap::Args;
use ecan_host::AdapterConfig;
use ecan_mcan_port::{ChannelConfig, GatewayConfig, PortConfig, PortPlan};

use crate::config_file;
use crate::failure::Failure;
use crate::frames::channels::Channels;
use crate::frames::options::SetupOptions;
use crate::output::{Output, Tone};

use report::Report;

/// Bit rate of a plan that names none, in bit/s: what a gateway has from the factory.
const BITRATE: u32 = 500_000;

/// The configuration and its traffic.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  ecan plan --slaves 3 --channel all
  ecan plan --config cell.toml --frames 4
  ecan plan --bitrate 1000000 --data-bitrate 5000000 --pdo-n 8 --channel 0,2
  ecan plan --channel all --replay drive.log

Without --bitrate it is 500000. Exit status 1 when the configuration would not work. Touches no bus.")]
pub struct PlanArguments {
    /// Number of gateways
    #[arg(long, value_name = "N", default_value_t = 1, conflicts_with = "config",
          value_parser = clap::value_parser!(u16).range(1..=64))]
    slaves: u16,
    /// CAN channels of every gateway, 0 to 3 with commas between, or all [default: 0, or all of the
    /// file]
    #[arg(long, value_name = "CHANNELS")]
    channel: Option<Channels>,
    /// Frames that each channel sends per cycle; as many come back
    #[arg(long, value_name = "N", default_value_t = 1)]
    frames: u32,
    /// Data bytes of each frame [default: 8, and 64 on a channel with CAN FD]
    #[arg(long, value_name = "N")]
    bytes: Option<u8>,
    /// Plan the frames of a candump log in place of these, at their mean rate; they go to one channel,
    /// or of several to the one that their interface names, counted over all gateways
    #[arg(long, value_name = "FILE", conflicts_with_all = ["frames", "bytes"])]
    replay: Option<PathBuf>,
    /// Another name of --data-bitrate
    #[arg(long, value_name = "BITRATE", hide = true, conflicts_with_all = ["data_bitrate", "config"])]
    fd: Option<u32>,
    #[command(flatten)]
    setup: SetupOptions,
}

/// The gateways and the channels that carry the traffic.
struct Planned {
    adapter: AdapterConfig,
    port: PortConfig,
    channels: Channels,
}

pub fn run(arguments: &PlanArguments, output: &Output) -> Result<(), Failure> {
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
    output.data(&Report::new(&plan, &faults), |out| {
        write!(out, "{}", plan.table(&adapter, &traffic))?;
        faults
            .iter()
            .try_for_each(|fault| writeln!(out, "{} {fault}", output.toned(Tone::Bad, "fault:")))
    })?;
    if faults.is_empty() { Ok(()) } else { Err(Failure::Amiss) }
}

fn of_options(arguments: &PlanArguments) -> Planned {
    let PlanArguments { slaves, fd, .. } = *arguments;
    let mut setup = arguments.setup.clone();
    setup.data_bitrate = setup.data_bitrate.or(fd);
    let otherwise = || Ok::<_, Infallible>(ChannelConfig::classic(BITRATE));
    let Ok(settings) = setup.channel(otherwise);
    let channels = arguments.channel.unwrap_or(Channels::only(0));
    let mut gateway = GatewayConfig::default();
    for (channel, place) in (0..).zip(&mut gateway.channels) {
        *place = channels.contains(channel).then(|| settings.clone());
    }
    let port = PortConfig::uniform(slaves.into(), gateway);
    Planned { adapter: setup.adapter(slaves), port, channels }
}
