//! `ecan node scan`: the nodes of all channels, and their report.

use std::collections::BTreeMap;
use std::io;
use std::io::Write;
use std::str::FromStr;
use std::time::Duration;

use clap::Args;
use ecan_canopen::{NmtState, NodeId, Sdo, SdoFault, object};
use ecan_tool_support::command_line::options::milliseconds;
use serde::Serialize;

use super::bit_rate_search;
use super::node_client::{decode_unsigned, requirements};
use super::node_link::{NodeLink, SdoRequest};
use super::node_target::NodeTarget;
use super::object_value::DeviceType;
use crate::context::{Context, Failure, Output, Result, Tone, note};
use crate::frames::{Channels, FrameOptions, Prepared};
use crate::output;
use crate::output::Progress;

pub const NOTES: &str = "\
A node is found if it answers an SDO request for 0x1000, or sends a heartbeat or a boot-up message.
All channels of all gateways are scanned in parallel, unless --slave or --channel selects.

--bitrates listens without acknowledging at each bit rate, so that a running bus is not disturbed. On
a channel where no frame arrives it then sends one request at each bit rate. A gateway needs up to
ten seconds for each bit rate. Not through a service, which has configured the bit rates.

Exit status 1 if no node is found.";

/// Node-IDs to ask: `1-127`, `5`, `1-10,32`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NodeRange(Vec<NodeId>);

impl FromStr for NodeRange {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let wrong = || "expected node-IDs 1 to 127, for example 1-10,32".to_owned();
        let node = |text: &str| text.parse().ok().and_then(NodeId::from_raw).ok_or_else(wrong);
        let mut nodes = Vec::new();
        for part in text.split(',') {
            let (first, last) = part.split_once('-').unwrap_or((part, part));
            let (first, last) = (node(first)?, node(last)?);
            if first > last {
                return Err(wrong());
            }
            nodes.extend((first.get()..=last.get()).filter_map(NodeId::from_raw));
        }
        nodes.sort_unstable();
        nodes.dedup();
        Ok(Self(nodes))
    }
}

#[derive(Debug, Args)]
pub struct ScanArguments {
    /// Channels 0 to 3, comma-separated, or all
    #[arg(long, value_name = "CHANNELS", default_value = "all")]
    channel: Channels,
    /// Node-IDs to ask, for example 1-10,32
    #[arg(long, value_name = "IDS", default_value = "1-127")]
    nodes: NodeRange,
    /// Time for the answer of a node
    #[arg(long, value_name = "TIME", default_value = "100ms", value_parser = milliseconds::<u64>(1..=60_000))]
    timeout: u64,
    /// Shortest time to wait for heartbeats
    #[arg(long, value_name = "TIME", default_value = "1s", value_parser = milliseconds::<u64>(0..=60_000))]
    listen: u64,
    /// Search the bit rate of each channel, by listening first
    #[arg(long, conflicts_with_all = ["config", "bitrate", "data_bitrate"])]
    bitrates: bool,
    #[command(flatten)]
    options: FrameOptions,
}

/// Transfers at the same time on a channel.
const WINDOW: usize = 8;
/// Time after which a channel without an acknowledgement ends its scan.
const SILENT_NS: u64 = 300_000_000;
/// Objects of a node that answered.
const INQUIRY: [(u16, u8); 6] = [
    (object::DEVICE_TYPE, 0),
    (object::IDENTITY, 1),
    (object::IDENTITY, 2),
    (object::IDENTITY, 3),
    (object::IDENTITY, 4),
    (object::DEVICE_NAME, 0),
];
const INQUIRY_TIMEOUT: Duration = Duration::from_millis(500);

pub fn run(arguments: &ScanArguments, context: &Context) -> Result {
    let context = &context.on_stderr(arguments.options.capture.is_on_output());
    let mut report = ScanReport::default();
    if arguments.bitrates {
        let searched = bit_rate_search::search(
            &arguments.options,
            arguments.channel,
            Duration::from_millis(arguments.listen),
            context,
        )?;
        for ((position, rate), channels) in searched.found {
            let options = arguments.options.at_bit_rate(rate);
            let mask = channels.iter().fold(0, |mask, channel| mask | 1 << channel);
            let global = bit_rate_search::of_slave(context.global, position);
            let context = Context { global: &global, output: context.output };
            report.add(scan(arguments, &options, Channels::of_mask(mask), &context)?);
        }
        report.channels.extend(searched.silent.into_iter().map(|(slave, channel)| {
            ScannedChannel { slave, channel, bitrate: None, result: ChannelResult::NoBitRate }
        }));
    } else {
        let (options, channels) = (&arguments.options, arguments.channel);
        report = scan(arguments, options, channels, context)?;
    }
    report.sort();
    context.output.data(&report, |out| report.print(&context.output, out))?;
    match report.nodes.is_empty() {
        true => Err(Failure::Incomplete("no node found".to_owned())),
        false => Ok(()),
    }
}

/// Scans the channels of the selected gateway, or of all.
fn scan(
    arguments: &ScanArguments,
    options: &FrameOptions,
    channels: Channels,
    context: &Context,
) -> Result<ScanReport> {
    let prepared = Prepared::for_all(options, requirements(channels, true), context)?;
    let bit_rate = |gateway, channel| prepared.can(gateway, channel).map(|can| can.nominal_bitrate);
    let rates: BTreeMap<_, _> = (0..prepared.gateways())
        .flat_map(|gateway| channels.iter().map(move |channel| (gateway, channel)))
        .filter_map(|(gateway, channel)| Some(((gateway, channel), bit_rate(gateway, channel)?)))
        .collect();
    let Some(service) = prepared.enter_ready()? else {
        return Err(Failure::Incomplete("stopped before the gateways were ready".to_owned()));
    };
    let mut scan = Scan::new(NodeLink::new(service), arguments);
    for ((gateway, channel), rate) in rates {
        if scan.link.service.channels(gateway).contains(channel) {
            scan.add_channel(gateway, channel, rate);
        }
    }
    let _progress = Progress::show("scanning the channels");
    let scanned = scan.run();
    let finished = scan.link.service.finish();
    scanned.and(finished)?;
    Ok(scan.report())
}

/// A channel that is being scanned.
#[derive(Debug)]
struct ChannelScan {
    gateway: usize,
    channel: u8,
    bitrate: u32,
    /// Node-IDs that have not been asked, the last one first.
    waiting: Vec<NodeId>,
    /// Requests that may be sent again, since their frames were lost before they were on the bus.
    repeats: usize,
    asked_since_ns: Option<u64>,
    is_silent: bool,
}

#[derive(Debug)]
struct Scan {
    link: NodeLink,
    channels: Vec<ChannelScan>,
    nodes: Vec<NodeId>,
    timeout: Duration,
    listen_ns: u64,
    requests: Vec<SdoRequest>,
    /// Number of the object in [`INQUIRY`] that each request reads.
    stages: Vec<usize>,
    found: BTreeMap<(usize, u8, u8), FoundNode>,
}

impl Scan {
    fn new(link: NodeLink, arguments: &ScanArguments) -> Self {
        Self {
            link,
            channels: Vec::new(),
            nodes: arguments.nodes.0.iter().rev().copied().collect(),
            timeout: Duration::from_millis(arguments.timeout),
            listen_ns: arguments.listen.saturating_mul(1_000_000),
            requests: Vec::new(),
            stages: Vec::new(),
            found: BTreeMap::new(),
        }
    }

    fn add_channel(&mut self, gateway: usize, channel: u8, bitrate: u32) {
        self.channels.push(ChannelScan {
            gateway,
            channel,
            bitrate,
            waiting: self.nodes.clone(),
            repeats: 2 * self.nodes.len(),
            asked_since_ns: None,
            is_silent: false,
        });
    }

    fn run(&mut self) -> Result {
        let end_ns = self.link.service.response_ns().saturating_add(self.listen_ns);
        loop {
            self.ask();
            let (found, link) = (&mut self.found, &mut self.link);
            let positions: Vec<_> = (0..link.service.gateways())
                .map(|gateway| link.service.position(gateway))
                .collect();
            let scanned: Vec<_> =
                self.channels.iter().map(|channel| (channel.gateway, channel.channel)).collect();
            let now_ns = link.cycle(&mut self.requests, |observed| {
                let (gateway, channel) = (observed.frame.gateway, observed.frame.channel);
                let is_scanned = scanned.contains(&(gateway, channel)) && !observed.frame.is_sent;
                if let (Some((node, state)), true) = (observed.state(), is_scanned) {
                    let slave = positions.get(gateway).copied().unwrap_or(0);
                    let node = node.get();
                    let entry = found
                        .entry((gateway, channel, node))
                        .or_insert_with(|| FoundNode::new(slave, channel, node));
                    // A boot-up message ends in the state pre-operational.
                    entry.state = Some(match state {
                        NmtState::Initialising => state_name(NmtState::PreOperational),
                        state => state_name(state),
                    });
                }
            })?;
            self.take_answers();
            self.give_up_silent(now_ns);
            let is_asking = self
                .channels
                .iter()
                .any(|channel| !channel.is_silent && !channel.waiting.is_empty());
            if !is_asking && self.requests.is_empty() && now_ns >= end_ns {
                return Ok(());
            }
        }
    }

    /// Starts requests, one at first on a channel that has acknowledged nothing.
    fn ask(&mut self) {
        let now_ns = self.link.service.response_ns();
        for it in &mut self.channels {
            let (gateway, channel) = (it.gateway, it.channel);
            let window = if self.link.is_alive((gateway, channel)) { WINDOW } else { 1 };
            let is_here = |request: &&SdoRequest| {
                request.gateway == gateway && request.target.channel == channel
            };
            let mut running = self.requests.iter().filter(is_here).count();
            while running < window
                && !it.is_silent
                && let Some(node) = it.waiting.pop()
            {
                it.asked_since_ns.get_or_insert(now_ns);
                let target = NodeTarget { channel, node };
                let mut request = SdoRequest::new(gateway, target, self.timeout, 0);
                let (index, subindex) = INQUIRY[0];
                // A new client is idle.
                let _ = request.client.start_upload(index, subindex);
                self.requests.push(request);
                self.stages.push(0);
                running += 1;
            }
        }
    }

    fn take_answers(&mut self) {
        let mut number = 0;
        while let (Some(request), Some(stage)) =
            (self.requests.get_mut(number), self.stages.get_mut(number))
        {
            let answer = match request.client.state() {
                Sdo::Busy => {
                    number += 1;
                    continue;
                }
                Sdo::Done { .. } => Some(request.client.data().to_vec()),
                // The node exists, but not the object.
                Sdo::Failed(SdoFault::Aborted(_)) => Some(Vec::new()),
                Sdo::Failed(_) | Sdo::Idle => None,
            };
            let NodeTarget { channel, node } = request.target;
            let key = (request.gateway, channel, node.get());
            if let Some(data) = &answer {
                let slave = self.link.service.position(request.gateway);
                let found = self
                    .found
                    .entry(key)
                    .or_insert_with(|| FoundNode::new(slave, channel, node.get()));
                found.has_sdo = true;
                take_value(found, *stage, data);
            }
            let next = *stage + 1;
            match INQUIRY.get(next).filter(|_| answer.is_some()) {
                Some((index, subindex)) => {
                    *stage = next;
                    if next == 1 {
                        *request =
                            SdoRequest::new(request.gateway, request.target, INQUIRY_TIMEOUT, 1);
                    }
                    // The last transfer has ended.
                    let _ = request.client.start_upload(*index, *subindex);
                    number += 1;
                }
                None => {
                    let is_unasked = *stage == 0 && request.has_lost_frame;
                    let place = (request.gateway, channel);
                    let mut channels = self.channels.iter_mut();
                    if is_unasked
                        && let Some(scan) =
                            channels.find(|scan| (scan.gateway, scan.channel) == place)
                    {
                        match scan.repeats.checked_sub(1) {
                            Some(repeats) => {
                                scan.repeats = repeats;
                                scan.waiting.push(node);
                            }
                            None => note(format_args!(
                                "# can{channel}: node {node} was not asked: its request was lost"
                            )),
                        }
                    }
                    self.requests.swap_remove(number);
                    self.stages.swap_remove(number);
                }
            }
        }
    }

    /// Ends the scan of channels on which no node acknowledges.
    fn give_up_silent(&mut self, now_ns: u64) {
        for it in &mut self.channels {
            let (gateway, channel) = (it.gateway, it.channel);
            let is_over = it.asked_since_ns.is_some_and(|at| now_ns.saturating_sub(at) > SILENT_NS);
            let place = (gateway, channel);
            let is_alive = self.link.is_alive(place) && !self.link.is_stalled(place);
            if !is_over || it.is_silent || is_alive || self.link.check_alive(place) {
                continue;
            }
            it.is_silent = true;
            let mut number = 0;
            while let Some(request) = self.requests.get(number) {
                match (request.gateway, request.target.channel) == (gateway, channel) {
                    true => {
                        self.requests.swap_remove(number);
                        self.stages.swap_remove(number);
                    }
                    false => number += 1,
                }
            }
        }
    }

    fn report(self) -> ScanReport {
        let channels = self.channels.iter().map(|found| ScannedChannel {
            slave: self.link.service.position(found.gateway),
            channel: found.channel,
            bitrate: Some(found.bitrate),
            result: match found.is_silent {
                true => ChannelResult::NotAcknowledged,
                false => ChannelResult::Scanned,
            },
        });
        ScanReport { channels: channels.collect(), nodes: self.found.into_values().collect() }
    }
}

fn take_value(found: &mut FoundNode, stage: usize, data: &[u8]) {
    if data.is_empty() {
        return;
    }
    let number = Some(decode_unsigned(data) as u32);
    match INQUIRY.get(stage) {
        Some((object::DEVICE_TYPE, _)) => found.device_type = number,
        Some((object::IDENTITY, 1)) => found.vendor_id = number,
        Some((object::IDENTITY, 2)) => found.product_code = number,
        Some((object::IDENTITY, 3)) => found.revision = number,
        Some((object::IDENTITY, 4)) => found.serial = number,
        Some((object::DEVICE_NAME, _)) => {
            let text = String::from_utf8_lossy(data);
            found.name = Some(text.trim_end_matches('\0').trim().to_owned());
        }
        _ => {}
    }
}

/// State of a channel of a gateway.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum ChannelResult {
    /// Nodes acknowledge frames.
    Scanned,
    /// No node acknowledges frames.
    NotAcknowledged,
    /// No bit rate was found.
    NoBitRate,
}

#[derive(Clone, Debug, Serialize)]
pub struct ScannedChannel {
    pub slave: usize,
    pub channel: u8,
    pub bitrate: Option<u32>,
    pub result: ChannelResult,
}

#[derive(Clone, Debug, Serialize)]
pub struct FoundNode {
    pub slave: usize,
    pub channel: u8,
    pub node: u8,
    /// State by heartbeat or boot-up message.
    pub state: Option<&'static str>,
    /// The node answers SDO requests.
    pub has_sdo: bool,
    pub device_type: Option<u32>,
    pub name: Option<String>,
    pub vendor_id: Option<u32>,
    pub product_code: Option<u32>,
    pub revision: Option<u32>,
    pub serial: Option<u32>,
}

impl FoundNode {
    pub fn new(slave: usize, channel: u8, node: u8) -> Self {
        Self {
            slave,
            channel,
            node,
            state: None,
            has_sdo: false,
            device_type: None,
            name: None,
            vendor_id: None,
            product_code: None,
            revision: None,
            serial: None,
        }
    }
}

#[derive(Clone, Debug, Default, Serialize)]
pub struct ScanReport {
    pub channels: Vec<ScannedChannel>,
    pub nodes: Vec<FoundNode>,
}

/// Name of a state, for JSON and text.
pub fn state_name(state: NmtState) -> &'static str {
    match state {
        NmtState::Initialising => "initialising",
        NmtState::Stopped => "stopped",
        NmtState::Operational => "operational",
        NmtState::PreOperational => "pre-operational",
    }
}

impl ScanReport {
    pub fn add(&mut self, other: Self) {
        self.channels.extend(other.channels);
        self.nodes.extend(other.nodes);
    }

    pub fn sort(&mut self) {
        self.channels.sort_by_key(|channel| (channel.slave, channel.channel));
        self.nodes.sort_by_key(|node| (node.slave, node.channel, node.node));
    }

    pub fn print(&self, output: &Output, out: &mut dyn Write) -> io::Result<()> {
        let titles = [
            "SLAVE", "CHANNEL", "NODE", "STATE", "VENDOR", "PRODUCT", "REVISION", "SERIAL",
            "DEVICE",
        ];
        if !self.nodes.is_empty() {
            output::print_with_titles(out, titles, &self.nodes, row)?;
            writeln!(out)?;
        }
        for it in &self.channels {
            let nodes = self
                .nodes
                .iter()
                .filter(|node| (node.slave, node.channel) == (it.slave, it.channel));
            let rate =
                it.bitrate.map_or_else(String::new, |rate| format!(" at {} kbit/s", kbit(rate)));
            let text = match it.result {
                ChannelResult::Scanned => format!("{} node(s){rate}", nodes.count()),
                ChannelResult::NotAcknowledged => output.toned(
                    Tone::Warning,
                    format!("no node acknowledges frames{rate}; check bit rate, wiring and supply"),
                ),
                ChannelResult::NoBitRate => {
                    output.toned(Tone::Warning, "no frame and no acknowledgement at any bit rate")
                }
            };
            writeln!(out, "slave {} can{}: {text}", it.slave, it.channel)?;
        }
        Ok(())
    }
}

fn kbit(rate: u32) -> f64 {
    f64::from(rate) / 1e3
}

fn row(it: &FoundNode) -> [String; 9] {
    let hexadecimal =
        |value: Option<u32>| value.map_or("-".to_owned(), |value| format!("0x{value:08X}"));
    let device = match (&it.name, it.device_type) {
        (_, _) if !it.has_sdo => "no answer to SDO requests".to_owned(),
        (Some(name), Some(ty)) => format!("{name}, {}", DeviceType(ty)),
        (Some(name), None) => name.clone(),
        (None, Some(ty)) => DeviceType(ty).to_string(),
        (None, None) => "-".to_owned(),
    };
    [
        it.slave.to_string(),
        format!("can{}", it.channel),
        it.node.to_string(),
        it.state.unwrap_or("-").to_owned(),
        hexadecimal(it.vendor_id),
        hexadecimal(it.product_code),
        hexadecimal(it.revision),
        it.serial.map_or("-".to_owned(), |serial| serial.to_string()),
        device,
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn node_ranges_are_sorted_and_checked() {
        let parse = |text: &str| {
            text.parse::<NodeRange>()
                .map(|range| range.0.iter().map(|id| id.get()).collect::<Vec<_>>())
        };
        assert_eq!(parse("32,1-3,2"), Ok(vec![1, 2, 3, 32]));
        assert_eq!(parse("1-127").map(|nodes| nodes.len()), Ok(127));
        for wrong in ["", "0", "128", "5-4", "1-", "1;2", "a"] {
            assert!(parse(wrong).is_err(), "{wrong}");
        }
    }
}
