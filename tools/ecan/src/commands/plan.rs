//! `ecan plan`: load of a configuration and of its traffic, with warnings.

use std::convert::Infallible;
use std::path::{Path, PathBuf};

use clap::Args;
use ecan_can_io::recording::ReadOptions;
use ecan_host::AdapterConfig;
use ecan_mcan_port::{
    ChannelConfig, CpuCost, FrameRate, FrameStream, GatewayConfig, ImageFill, ImagePlan,
    PortConfig, PortPlan,
};
use ecan_protocol::can::{CanFrame, CanId};
use ecan_protocol::mapping::Direction;
use ecan_tool_support::command_line::options::parse_bit_rate;
use serde::Serialize;

use crate::config_file;
use crate::context::{Context, Failure, Result, Tone};
use crate::frames::{Channels, Recorded, SetupOptions, read_recording};

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
    let traffic = plan_traffic(arguments, &planned)?;
    let Planned { adapter, port, .. } = planned;
    let plan = PortPlan::of(&adapter, &port, &traffic);
    let faults = plan.faults(&adapter, &port);
    let output = &context.output;
    output.data(&Report::new(&plan, &faults), |out| {
        write!(out, "{}", ecan_lite::plan_table(&plan, &adapter, &traffic))?;
        state_advice(&plan).iter().try_for_each(|advice| writeln!(out, "note: {advice}"))?;
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
    Planned { adapter: setup.adapter(&port), port, channels }
}

/// Cycle below which a kernel without PREEMPT_RT is not suitable, in ns.
const STOCK_KERNEL_NS: u32 = 2_000_000;

/// Measured with IgH 1.6.2 on Debian kernels 6.1 with and without PREEMPT_RT.
fn state_advice(plan: &PortPlan) -> Vec<String> {
    let mut advice = Vec::new();
    let wire = &plan.ethercat;
    if wire.slaves.iter().any(|slave| !slave.layout.is_single_datagram()) {
        advice.push(
            "from N = 6, outputs and inputs of a gateway are two datagrams: run the cycle with a \
             real-time priority (--rt-priority) above that of other programs; otherwise some cycles \
             have an incomplete working counter, and their images are repeated"
                .to_owned(),
        );
    }
    if wire.cycle_ns < STOCK_KERNEL_NS {
        advice.push(format!(
            "a cycle of {:.1} us needs a kernel with PREEMPT_RT and a real-time priority; check the \
             host with `ecan doctor`",
            f64::from(wire.cycle_ns) / 1e3
        ));
    }
    advice
}

#[derive(Debug, Serialize)]
struct Report {
    cycle_ns: u32,
    wire_ns: u64,
    wire_bytes: usize,
    /// Per cycle.
    wire_share: f64,
    /// Estimate for the images only.
    cpu_ns: f64,
    working_counter: WorkingCounter,
    mailbox: Mailbox,
    channels: Vec<Channel>,
    images: Vec<Image>,
    warnings: Vec<String>,
    /// For the host.
    notes: Vec<String>,
    faults: Vec<String>,
}

/// Expected working counter per release of IgH.
#[derive(Debug, Serialize)]
struct WorkingCounter {
    igh_1_6: u32,
    igh_1_5: u32,
}

#[derive(Debug, Serialize)]
struct Mailbox {
    available_bytes: usize,
    headroom_bytes: usize,
    transfers_per_cycle: usize,
}

#[derive(Debug, Serialize)]
struct Channel {
    slave: usize,
    channel: u8,
    sent_per_cycle: f64,
    received_per_cycle: f64,
    /// Frames per service of the gateway, from the bus and to the bus.
    rx_budget: u8,
    tx_budget: u8,
    least_load: f64,
    most_load: f64,
}

#[derive(Debug, Serialize)]
struct Image {
    slave: usize,
    direction: String,
    area_bytes: usize,
    mean: Fill,
    fullest: Fill,
}

#[derive(Debug, Serialize)]
struct Fill {
    packets: f64,
    bytes: f64,
}

impl Report {
    fn new(plan: &PortPlan, faults: &[String]) -> Self {
        let wire = &plan.ethercat;
        let (igh_1_6, igh_1_5) =
            (wire.expected_working_counter((1, 6)), wire.expected_working_counter((1, 5)));
        let channels = plan.channels.iter().map(|planned| Channel {
            slave: planned.slave,
            channel: planned.channel,
            sent_per_cycle: planned.load.mean_sent,
            received_per_cycle: planned.load.mean_received,
            rx_budget: planned.drain,
            tx_budget: planned.serve,
            least_load: planned.load.least,
            most_load: planned.load.most,
        });
        let gateways = plan.gateways.iter().enumerate();
        let images = gateways.flat_map(|(slave, gateway)| {
            [&gateway.rx, &gateway.tx].map(|image| Image::of(slave, image))
        });
        Self {
            cycle_ns: wire.cycle_ns,
            wire_ns: wire.wire_ns(),
            wire_bytes: wire.wire_bytes(),
            wire_share: wire.wire_share(),
            cpu_ns: plan.cpu_ns(CpuCost::MEASURED),
            working_counter: WorkingCounter { igh_1_6, igh_1_5 },
            mailbox: Mailbox {
                available_bytes: wire.mailbox.available_bytes,
                headroom_bytes: wire.mailbox.headroom_bytes(),
                transfers_per_cycle: wire.mailbox.transfers(),
            },
            channels: channels.collect(),
            images: images.collect(),
            warnings: plan.warnings.iter().map(ToString::to_string).collect(),
            notes: state_advice(plan),
            faults: faults.to_vec(),
        }
    }
}

impl Image {
    fn of(slave: usize, image: &ImagePlan) -> Self {
        let fill = |fill: &ImageFill| Fill { packets: fill.packets, bytes: fill.bytes };
        Self {
            slave,
            direction: image.direction.to_string(),
            area_bytes: image.area_bytes(),
            mean: fill(&image.mean),
            fullest: fill(&image.peak),
        }
    }
}

const FRAME_ID: u16 = 0x123;

/// Traffic sent; the same amount is received. Channels of one direction have traffic in that one.
fn plan_traffic(arguments: &PlanArguments, planned: &Planned) -> Result<Vec<FrameStream>> {
    let carries = |stream: &FrameStream, direction| {
        let gateway = planned.port.gateways.get(stream.slave);
        gateway.is_some_and(|gateway| gateway.carries(direction, stream.channel))
    };
    let (all, sent) = match &arguments.replay {
        Some(path) => {
            let sent = read_traffic(path, planned)?;
            (sent.clone(), sent)
        }
        None => {
            let all = spread_evenly(arguments, planned)?;
            let sends = |stream: &&FrameStream| carries(stream, Direction::RxPdo);
            let sent = all.iter().filter(sends).copied().collect();
            (all, sent)
        }
    };
    let back = all.iter().filter(|stream| carries(stream, Direction::TxPdo));
    let back = back.map(|stream| {
        FrameStream::from_bus(stream.slave, stream.channel, stream.frame, stream.rate)
    });
    let back: Vec<_> = back.collect();
    Ok([sent, back].concat())
}

fn spread_evenly(arguments: &PlanArguments, planned: &Planned) -> Result<Vec<FrameStream>> {
    let rate = FrameRate::PerCycle(arguments.frames);
    let mut streams = Vec::new();
    for (slave, gateway) in planned.port.gateways.iter().enumerate() {
        for (channel, settings) in (0..).zip(&gateway.channels) {
            let Some(settings) = settings else { continue };
            if planned.channels.contains(channel) {
                let frame = test_frame(settings.can.fd, arguments.bytes)?;
                streams.push(FrameStream::to_bus(slave, channel, frame, rate));
            }
        }
    }
    match streams.is_empty() {
        false => Ok(streams),
        true => Err(Failure::Usage("no gateway has one of the selected channels".to_owned())),
    }
}

fn test_frame(is_fd: bool, bytes: Option<u8>) -> Result<CanFrame> {
    let bytes = bytes.unwrap_or(if is_fd { 64 } else { 8 });
    let wrong = |error: &dyn std::fmt::Display| {
        Failure::Usage(format!("a frame of {bytes} bytes: {error}"))
    };
    let id = CanId::standard(FRAME_ID).map_err(|error| wrong(&error))?;
    let data = vec![0; usize::from(bytes)];
    let frame = match is_fd {
        true => CanFrame::fd(id, &data, true, false),
        false => CanFrame::classic(id, &data),
    };
    frame.map_err(|error| wrong(&error))
}

/// Frames of one length and format on a channel.
struct TrafficGroup {
    first: Recorded,
    count: u32,
}

fn read_traffic(path: &Path, planned: &Planned) -> Result<Vec<FrameStream>> {
    let gateways = planned.port.gateways.len();
    let frames = read_recording(path, &ReadOptions::default(), planned.channels, gateways)?.frames;
    let times = || frames.iter().map(|frame| frame.logged.time_ns);
    let (first_ns, last_ns) = (times().min().unwrap_or(0), times().max().unwrap_or(0));
    let form = |recorded: &Recorded| {
        let frame = &recorded.logged.frame;
        (recorded.gateway, recorded.channel, frame.kind(), frame.len(), frame.id().is_extended())
    };
    let mut groups: Vec<TrafficGroup> = Vec::new();
    for frame in frames {
        match groups.iter_mut().find(|group| form(&group.first) == form(&frame)) {
            Some(group) => group.count += 1,
            None => groups.push(TrafficGroup { first: frame, count: 1 }),
        }
    }
    let seconds = last_ns.saturating_sub(first_ns) as f64 / 1e9;
    let stream = |TrafficGroup { first, count }: TrafficGroup| {
        let rate = if seconds > 0.0 {
            FrameRate::PerSecond(f64::from(count) / seconds)
        } else {
            FrameRate::PerCycle(count)
        };
        FrameStream::to_bus(first.gateway, first.channel, first.logged.frame, rate)
    };
    Ok(groups.into_iter().map(stream).collect())
}
