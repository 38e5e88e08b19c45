//! `ecan plan`: what a configuration costs, and what speaks against it.

mod traffic;

use std::path::PathBuf;

use clap::Args;
use ecan_host::AdapterConfig;
use ecan_mcan_port::{ChannelSettings, GatewayConfig, PortConfig, PortPlan};
use ecan_protocol::CHANNELS;
use serde::Serialize;

use crate::failure::Failure;
use crate::output::{Output, Tone};

/// The configuration and its traffic.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  ecan plan --slaves 3 --pdo-n 5 --cycle-us 1000 --channel all
  ecan plan --fd 5000000 --pdo-n 8 --cycle-us 1000 --frames 4
  ecan plan --pdo-n 5 --cycle-us 1000 --channel all --replay drive.log

Exit status 1 when the configuration would not work. Touches no bus.")]
pub struct PlanArguments {
    /// Number of gateways
    #[arg(long, value_name = "N", default_value_t = 1,
          value_parser = clap::value_parser!(u16).range(1..=64))]
    slaves: u16,
    /// PDO size per direction, in chunks of 128 bytes
    #[arg(long, value_name = "N", default_value_t = 3)]
    pdo_n: u8,
    /// The installed master carries more than 1486 bytes of process data per sync manager
    #[arg(long)]
    large_pdos: bool,
    /// Nominal bit rate in bit/s
    #[arg(long, value_name = "BITRATE", default_value_t = 1_000_000)]
    bitrate: u32,
    /// Use CAN FD with this data bit rate in bit/s
    #[arg(long, value_name = "DATA_BITRATE")]
    fd: Option<u32>,
    /// EtherCAT cycle in microseconds
    #[arg(long, value_name = "US", default_value_t = 10_000,
          value_parser = clap::value_parser!(u32).range(1..=4_000_000))]
    cycle_us: u32,
    /// CAN channel of every gateway, 0 to 3, or `all`
    #[arg(long, value_name = "CHANNEL", default_value = "0", value_parser = parse_channels)]
    channel: Channels,
    /// Frames that each channel sends per cycle; as many come back
    #[arg(long, value_name = "N", default_value_t = 1)]
    frames: u32,
    /// Data bytes of each frame [default: 8, and 64 with --fd]
    #[arg(long, value_name = "N")]
    bytes: Option<u8>,
    /// Plan the frames of a candump log in place of these, at their mean rate; with `--channel all`
    /// a frame goes to the channel that its interface names, counted over all gateways
    #[arg(long, value_name = "FILE", conflicts_with_all = ["frames", "bytes"])]
    replay: Option<PathBuf>,
}

/// One channel or all.
#[derive(Clone, Copy, Debug)]
enum Channels {
    One(u8),
    All,
}

fn parse_channels(text: &str) -> Result<Channels, String> {
    match text {
        "all" => Ok(Channels::All),
        _ => crate::channel::parse(text)
            .map(Channels::One)
            .map_err(|_| format!("expected 0 to {} or `all`", CHANNELS - 1)),
    }
}

/// The load of a channel.
#[derive(Debug, Serialize)]
struct ChannelLoad {
    slave: usize,
    channel: u8,
    least_load: f64,
    most_load: f64,
}

/// The plan for programs.
#[derive(Debug, Serialize)]
struct Planned {
    cycle_ns: u32,
    wire_ns: u64,
    channels: Vec<ChannelLoad>,
    warnings: Vec<String>,
    faults: Vec<String>,
}

pub fn run(arguments: &PlanArguments, output: &Output) -> Result<(), Failure> {
    let (adapter, port) = configuration(arguments);
    let traffic = traffic::of(arguments)?;
    let plan = PortPlan::of(&adapter, &port, &traffic);
    let faults = plan.faults(&adapter, &port);
    let planned = Planned {
        cycle_ns: plan.ethercat.cycle_ns,
        wire_ns: plan.ethercat.frames.iter().map(|frame| frame.wire_ns()).sum(),
        channels: plan
            .channels
            .iter()
            .map(|it| ChannelLoad {
                slave: it.slave,
                channel: it.channel,
                least_load: it.load.least,
                most_load: it.load.most,
            })
            .collect(),
        warnings: plan.warnings.iter().map(ToString::to_string).collect(),
        faults: faults.clone(),
    };
    output.data(&planned, |out| {
        write!(out, "{}", plan.table(&adapter, &traffic))?;
        faults
            .iter()
            .try_for_each(|fault| writeln!(out, "{} {fault}", output.toned(Tone::Bad, "fault:")))
    })?;
    if faults.is_empty() { Ok(()) } else { Err(Failure::Amiss) }
}

fn configuration(arguments: &PlanArguments) -> (AdapterConfig, PortConfig) {
    let mut adapter = AdapterConfig::new(arguments.slaves)
        .with_multiplier(arguments.pdo_n)
        .with_cycle_us(arguments.cycle_us);
    adapter.allow_large_pdos = arguments.large_pdos;
    let settings = match arguments.fd {
        Some(data_bitrate) => ChannelSettings::fd(arguments.bitrate, data_bitrate),
        None => ChannelSettings::classic(arguments.bitrate),
    };
    let gateway = match arguments.channel {
        Channels::One(channel) => GatewayConfig::on_channel(channel, settings),
        Channels::All => GatewayConfig::on_all_channels(&settings),
    };
    (adapter, PortConfig::uniform(usize::from(arguments.slaves), gateway))
}
