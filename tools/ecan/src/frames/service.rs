//! Running gateways with their cycle, for the frame commands, and the reports of their status: changes while a command
//! runs, and the events that a service has recorded.

use std::fmt::Display;
use std::io::Write;
use std::path::Path;
use std::time::Duration;

use ecan_mcan_port::{
    BusEvent, GatewayCondition, GatewayWatch, ImageLossWatch, PortError, SlaveStatistics,
};
use ecan_protocol::can::CanFrame;
use ecan_protocol::config::McanChannelConfig;
use ecan_protocol::image::ChannelStatus;
use ecan_protocol::mapping::{CHANNELS, Direction};
use ecan_protocol::text::Printable;
use ecan_service::protocol::{Gateway, Hello, RecordedEvent, RecordedEvents};
use ecan_tool_support::command_line::interrupt::Interrupt;
use serde::Serialize;

use super::capture::FrameCapture;
use super::channels::{BitRates, Channels, can_config};
use super::link::{Arrival, BusFrame, Event, FrameLink, Ticket};
use super::printer::{Style, Timestamps};
use crate::context::{Failure, Result, note};
use crate::service_access::{ServiceConnection, program};

/// Default depth of a channel's transmit cache (manual 13.8).
pub const CACHE_DEPTH: u32 = 64;

/// Longest observed time of one cycle, or twice its period if that is longer.
const MAX_OBSERVED_NS: u64 = 100_000_000;

/// Time that counts only while it is observed: of a pause of this process, of the machine or of the
/// service, it counts a tenth of a second. A limit of a second or more then never expires in a pause.
#[derive(Clone, Copy, Debug)]
struct ObservedTime {
    total_ns: u64,
    last_ns: u64,
}

impl ObservedTime {
    fn start(now_ns: u64) -> Self {
        Self { total_ns: 0, last_ns: now_ns }
    }

    fn advance(&mut self, now_ns: u64, period_ns: u64) {
        let longest_ns = MAX_OBSERVED_NS.max(2 * period_ns);
        self.total_ns += now_ns.saturating_sub(self.last_ns).min(longest_ns);
        self.last_ns = now_ns;
    }
}

/// Time in which a gateway has reported its status: one period for each received image, so that it
/// also runs slower where cycles are late. Of a pause in which the service received images, it counts
/// a tenth of a second.
#[derive(Clone, Copy, Debug)]
struct StatusTime {
    total_ns: u64,
    /// Number of received images.
    images: u64,
}

impl StatusTime {
    fn advance(&mut self, images: u64, period_ns: u64) {
        let new = images.saturating_sub(self.images);
        self.total_ns += new.saturating_mul(period_ns).min(MAX_OBSERVED_NS.max(2 * period_ns));
        self.images = images;
    }
}

/// A gateway of a frame command.
#[derive(Debug)]
pub struct ServedGateway {
    /// Position on the bus.
    pub position: usize,
    /// Channels of the command.
    pub channels: Channels,
    /// Depth of the firmware's transmit cache per channel (0xF000:29).
    pub cache_depth: u32,
}

#[derive(Debug)]
pub struct Cycle {
    /// Start time on the cycle clock, in nanoseconds.
    pub now_ns: u64,
    pub arrivals: Vec<Arrival>,
}

/// Running gateways. A gateway is its index in the command.
#[derive(Debug)]
pub struct Service {
    link: Box<dyn FrameLink>,
    gateways: Vec<ServedGateway>,
    /// An empty buffer, outside a cycle.
    store: Vec<Arrival>,
    cycle_time: ObservedTime,
    /// Of each gateway.
    status_times: Vec<StatusTime>,
    gaps: Vec<Gap>,
    watch: StatusWatch,
    capture: Option<FrameCapture>,
    interrupt: Interrupt,
}

impl Service {
    pub fn new(
        link: Box<dyn FrameLink>,
        gateways: Vec<ServedGateway>,
        capture: Option<FrameCapture>,
        interrupt: Interrupt,
    ) -> Self {
        let watched: Vec<_> =
            gateways.iter().map(|gateway| (gateway.position, gateway.channels)).collect();
        let watch = StatusWatch::new(&watched, link.as_ref());
        let (is_real_time, since_1970_ns) = (link.is_real_time(), link.since_1970_ns());
        let capture = capture.map(|capture| capture.with_time(is_real_time, since_1970_ns));
        let cycle_time = ObservedTime::start(link.now_ns());
        let images = |gateway| link.statistics(gateway).txpdo_received;
        let status_times = (0..gateways.len())
            .map(|gateway| StatusTime { total_ns: 0, images: images(gateway) })
            .collect();
        let gap = |gateway| Gap { seen: Gap::lost(link.statistics(gateway)), images: 0 };
        let gaps = (0..gateways.len()).map(gap).collect();
        let store = Vec::new();
        Self { link, gateways, store, cycle_time, status_times, gaps, watch, capture, interrupt }
    }

    pub fn begin(&mut self) -> Cycle {
        self.begin_with(|_| true)
    }

    /// As [`begin`](Self::begin); frames for which `accepts` is false are dropped, also from the
    /// capture.
    pub fn begin_with(&mut self, mut accepts: impl FnMut(&BusFrame) -> bool) -> Cycle {
        let mut arrivals = std::mem::take(&mut self.store);
        let now_ns = self.link.begin(&mut arrivals);
        let period_ns = self.cycle_ns();
        self.cycle_time.advance(now_ns, period_ns);
        for (gateway, status) in self.status_times.iter_mut().enumerate() {
            status.advance(self.link.statistics(gateway).txpdo_received, period_ns);
        }
        for (gateway, gap) in self.gaps.iter_mut().enumerate() {
            let lost = gap.advance(self.link.statistics(gateway));
            if let Some(capture) = self.capture.as_mut().filter(|_| lost > 0) {
                capture.lost_images(lost);
            }
        }
        arrivals.retain(|arrival| match &arrival.event {
            Event::Frame(received) => {
                let channels = self.channels(received.gateway);
                channels.contains(received.channel) && accepts(received)
            }
            Event::Result { .. } => true,
        });
        if let Some(capture) = &mut self.capture {
            capture.after_begin(self.link.as_ref(), now_ns, &arrivals);
        }
        Cycle { now_ns, arrivals }
    }

    /// Images of a gateway that were lost, or incomplete in the gateway, since the last call: frames may be missing
    /// before those of this cycle.
    pub fn take_gap(&mut self, gateway: usize) -> Option<u64> {
        let gap = self.gaps.get_mut(gateway)?;
        Some(std::mem::take(&mut gap.images)).filter(|images| *images > 0)
    }

    /// Sends a frame; `None` without space in this cycle.
    pub fn send(
        &mut self,
        gateway: usize,
        channel: u8,
        frame: &CanFrame,
    ) -> Result<Option<Ticket>> {
        let sent = self.link.send(gateway, channel, frame)?;
        if let (Some(capture), Some(ticket)) = (&mut self.capture, sent) {
            capture.add_pending(ticket, gateway, channel, frame);
        }
        Ok(sent)
    }

    /// Ends a cycle and reports bus changes on standard error. Fails if the capture cannot be
    /// written.
    pub fn end(&mut self, cycle: Cycle) -> Result {
        let ended = self.link.end();
        self.store = cycle.arrivals;
        self.store.clear();
        if let Some(capture) = &mut self.capture {
            capture.after_end(self.link.as_ref());
            if capture.is_over() {
                self.finish_capture()?;
            }
        }
        let say = comments(self.absolute_ns(cycle.now_ns));
        self.watch.look(self.link.as_ref(), cycle.now_ns, say);
        ended
    }

    /// Reports the remaining changes and finishes the capture.
    pub fn finish(&mut self) -> Result {
        let say = comments(self.absolute_ns(self.now_ns()));
        self.watch.finish(self.link.as_ref(), say);
        self.finish_capture()
    }

    fn finish_capture(&mut self) -> Result {
        self.capture.take().map_or(Ok(()), |capture| capture.finish())
    }

    /// Number of gateways.
    pub fn gateways(&self) -> usize {
        self.gateways.len()
    }

    /// Position of a gateway on the bus.
    pub fn position(&self, gateway: usize) -> usize {
        self.gateways.get(gateway).map_or(0, |gateway| gateway.position)
    }

    /// Channels of the command on a gateway.
    pub fn channels(&self, gateway: usize) -> Channels {
        self.gateways.get(gateway).map_or(Channels::NONE, |gateway| gateway.channels)
    }

    /// Configuration of a channel; `None` if it is disabled.
    pub fn can(&self, gateway: usize, channel: u8) -> Option<&McanChannelConfig> {
        can_config(self.link.port_config(), gateway, channel)
    }

    /// Returns whether a channel carries frames in this direction.
    pub fn carries(&self, gateway: usize, direction: Direction, channel: u8) -> bool {
        let gateway = self.link.port_config().gateways.get(gateway);
        gateway.is_some_and(|gateway| gateway.carries(direction, channel))
    }

    /// Maximum number of frames in a channel: firmware cache and CAN controller.
    pub fn capacity(&self, gateway: usize, channel: u8) -> u64 {
        let controller = self.can(gateway, channel).map_or(0, |can| can.ram.tx_fifo_size);
        let cache = self.gateways.get(gateway).map_or(0, |gateway| gateway.cache_depth);
        u64::from(cache) + u64::from(controller)
    }

    pub fn condition(&self, gateway: usize) -> GatewayCondition {
        self.link.condition(gateway)
    }

    /// Returns whether frames can be sent to a gateway.
    pub fn is_ready(&self, gateway: usize) -> bool {
        self.condition(gateway).is_ready()
    }

    /// A gateway that is not ready.
    pub fn lost_gateway(&self) -> Option<usize> {
        (0..self.gateways.len()).find(|gateway| !self.is_ready(*gateway))
    }

    /// Status of a channel; "disabled" for one that is not enabled.
    pub fn channel_status(&self, gateway: usize, channel: u8) -> ChannelStatus {
        self.link.channel_status(gateway, channel)
    }

    /// Counters of a gateway since the start of the command.
    pub fn statistics(&self, gateway: usize) -> SlaveStatistics {
        self.link.statistics(gateway)
    }

    /// Uploads an object of at most 4 bytes in parallel with the cycle.
    pub fn upload(&mut self, gateway: usize, index: u16, subindex: u8) -> Result<u32> {
        self.link.upload(gateway, index, subindex)
    }

    pub fn not_ready(&self, gateway: usize, what: &str) -> Failure {
        let condition = self.condition(gateway);
        let reason = match condition.is_ready() {
            true => format!("lost temporarily: {what}"),
            false => format!("{}: {what}", BusEvent::Lost(condition.step())),
        };
        Failure::NotReady { position: self.position(gateway), reason }
    }

    /// Text for missing frames of the only gateway, with the bit rates.
    pub fn silence(&self) -> String {
        let (counts, channels) = (self.statistics(0).channels, self.channels(0));
        if channels
            .iter()
            .any(|at| counts.get(usize::from(at)).is_some_and(|count| count.frames_received > 0))
        {
            return "no received frame passes the filters".to_owned();
        }
        if !self.is_ready(0) {
            return "no frame received".to_owned();
        }
        let mut rates: Vec<_> = channels
            .iter()
            .filter_map(|channel| Some((channel, BitRates::of(self.can(0, channel)?))))
            .collect();
        let is_alike = rates.windows(2).all(|pair| matches!(pair, [a, b] if a.1 == b.1));
        rates.truncate(if is_alike { 1 } else { CHANNELS });
        let message: Vec<_> = match is_alike {
            true => rates.iter().map(|(_, rates)| rates.to_string()).collect(),
            false => rates.iter().map(|(at, rates)| format!("{rates} on can{at}")).collect(),
        };
        format!("no frame received; check that the other nodes use {}", message.join(", "))
    }

    /// Returns whether the user has stopped the command.
    pub fn is_interrupted(&self) -> bool {
        self.interrupt.is_set()
    }

    /// Time of the cycle clock in nanoseconds.
    pub fn now_ns(&self) -> u64 {
        self.link.now_ns()
    }

    /// Time of the cycles of this command in nanoseconds, for limits: a pause does not count.
    pub fn observed_ns(&self) -> u64 {
        self.cycle_time.total_ns
    }

    /// Time in which nodes could respond, in nanoseconds: as [`observed_ns`](Self::observed_ns), and
    /// through a service no more than the cycles of the service.
    pub fn response_ns(&self) -> u64 {
        let cycles_ns = self.link.cycles().map(|cycles| cycles.saturating_mul(self.cycle_ns()));
        self.observed_ns().min(cycles_ns.unwrap_or(u64::MAX))
    }

    /// Time in which a gateway has reported its status, in nanoseconds of its images, for limits on what
    /// the bus shows: neither a pause nor a loss of images counts.
    pub fn status_ns(&self, gateway: usize) -> u64 {
        self.status_times.get(gateway).map_or(0, |status| status.total_ns)
    }

    /// Period of the cycle in nanoseconds.
    pub fn cycle_ns(&self) -> u64 {
        self.link.adapter_config().cycle_ns().into()
    }

    /// Converts a time of the cycle clock to the time since 1970, or of a stepped simulation.
    pub fn absolute_ns(&self, time_ns: u64) -> u64 {
        time_ns.wrapping_add(self.link.since_1970_ns())
    }

    pub fn is_real_time(&self) -> bool {
        self.link.is_real_time()
    }
}

/// Status lines with a time stamp on standard error.
fn comments(time_ns: u64) -> impl FnMut(String) {
    let (seconds, micros) = parts(time_ns);
    move |line| note(format_args!("# ({seconds:010}.{micros:06}) {line}"))
}

fn parts(time_ns: u64) -> (u64, u64) {
    (time_ns / 1_000_000_000, time_ns / 1000 % 1_000_000)
}

pub fn without_fd(what: impl Display, channel: u8, file: Option<&Path>) -> Failure {
    Failure::Usage(match file {
        None => format!("{what}: channel {channel} has no data bit rate; set --data-bitrate"),
        Some(path) => {
            format!(
                "{what}: channel {channel} has no data_bitrate in {}",
                Printable(path.display())
            )
        }
    })
}

pub fn failure(position: usize, error: PortError) -> Failure {
    match error {
        PortError::Config(faults) => Failure::Usage(faults.to_string()),
        PortError::Adapter(ecan_host::Error::Config(faults)) => Failure::Usage(faults.to_string()),
        PortError::Adapter(ecan_host::Error::Open(error)) => Failure::Master(error.to_string()),
        PortError::Cycle(error) => Failure::Master(error.to_string()),
        error => Failure::NotReady { position, reason: error.to_string() },
    }
}

/// Gap in the frames of a gateway.
#[derive(Debug)]
struct Gap {
    /// Lost images so far.
    seen: u64,
    /// Those that are not marked yet.
    images: u64,
}

impl Gap {
    fn lost(statistics: SlaveStatistics) -> u64 {
        statistics.txpdo_lost + statistics.txpdo_unknown + statistics.txpdo_incomplete
    }

    /// Returns the images that were lost since the last call.
    fn advance(&mut self, statistics: SlaveStatistics) -> u64 {
        let lost = Self::lost(statistics);
        // A service that restarts counts from 0.
        let new = lost.saturating_sub(self.seen);
        self.images += new;
        self.seen = lost;
        new
    }
}

/// Interval of the reports of losses, for example of lost images.
pub const LOSS_INTERVAL: Duration = Duration::from_secs(1);

/// Reported state of a gateway.
#[derive(Debug)]
struct ReportedGateway {
    gateway: usize,
    /// Names the gateway if there are several.
    prefix: String,
    channels: Channels,
    watch: GatewayWatch,
    losses: ImageLossWatch,
}

impl ReportedGateway {
    fn new(gateway: usize, prefix: String, channels: Channels, link: &dyn FrameLink) -> Self {
        let counters = link.statistics(gateway);
        let watch = GatewayWatch::new(true, &counters);
        let losses = ImageLossWatch::new(&counters, LOSS_INTERVAL);
        Self { gateway, prefix, channels, watch, losses }
    }

    fn look(&mut self, link: &dyn FrameLink, now_ns: u64, report: &mut impl FnMut(String)) {
        let Self { gateway, prefix, channels, watch, .. } = self;
        let now = link.condition(*gateway);
        for event in watch.events(now, now_ns) {
            let rates = match event {
                BusEvent::Channel(channel, _) if is_disturbed(&now, channel) => {
                    let can = can_config(link.port_config(), *gateway, channel);
                    can.map_or_else(String::new, |can| format!(", at {}", BitRates::of(can)))
                }
                _ => String::new(),
            };
            let line = line(prefix, *channels, event);
            line.into_iter().for_each(|line| report(format!("{line}{rates}")));
        }
        self.report_losses(&now, now_ns, report);
    }

    fn finish(&mut self, link: &dyn FrameLink, report: &mut impl FnMut(String)) {
        self.report_losses(&link.condition(self.gateway), u64::MAX, report);
        let Self { prefix, channels, watch, .. } = self;
        watch.rest().filter_map(|event| line(prefix, *channels, event)).for_each(report);
    }

    fn report_losses(
        &mut self,
        now: &GatewayCondition,
        now_ns: u64,
        report: &mut impl FnMut(String),
    ) {
        let losses = self.losses.losses(&now.statistics, now_ns);
        losses.for_each(|loss| report(format!("{}gateway: {loss}", self.prefix)));
    }
}

/// Line of an event; `None` for one of another channel.
fn line(prefix: &str, channels: Channels, event: BusEvent) -> Option<String> {
    match event {
        BusEvent::Channel(channel, change) => {
            channels.contains(channel).then(|| format!("{prefix}can{channel}: {change}"))
        }
        event => Some(format!("{prefix}gateway: {event}")),
    }
}

/// Returns whether the bit rates of a channel may be the cause of its condition.
fn is_disturbed(gateway: &GatewayCondition, channel: u8) -> bool {
    let status = gateway.channels.get(usize::from(channel)).copied().flatten();
    status.is_some_and(|status| status.warn() || status.bus_off())
}

#[derive(Debug)]
pub struct StatusWatch {
    gateways: Vec<ReportedGateway>,
}

impl StatusWatch {
    /// Starts with ready gateways and running channels: the position of each gateway, and the
    /// channels whose changes are reported.
    pub fn new(gateways: &[(usize, Channels)], link: &dyn FrameLink) -> Self {
        let watch = |(gateway, (position, channels)): (usize, &(usize, Channels))| {
            let prefix = match gateways {
                [_] => String::new(),
                _ => format!("slave {position} "),
            };
            ReportedGateway::new(gateway, prefix, *channels, link)
        };
        Self { gateways: gateways.iter().enumerate().map(watch).collect() }
    }

    /// Passes a line for each change to `report`: lost images, and up to one per second and channel in
    /// the long run.
    pub fn look(&mut self, link: &dyn FrameLink, now_ns: u64, mut report: impl FnMut(String)) {
        self.gateways.iter_mut().for_each(|gateway| gateway.look(link, now_ns, &mut report));
    }

    pub fn finish(&mut self, link: &dyn FrameLink, mut report: impl FnMut(String)) {
        self.gateways.iter_mut().for_each(|gateway| gateway.finish(link, &mut report));
    }
}

/// Events that a service has recorded.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ServiceEvents {
    #[serde(flatten)]
    recorded: RecordedEvents,
    #[serde(skip)]
    hello: Hello,
}

impl ServiceEvents {
    pub fn new(hello: Hello, recorded: RecordedEvents) -> Self {
        Self { recorded, hello }
    }

    /// `None` if the service does not record any, or does not respond.
    pub fn read(connection: &ServiceConnection) -> Option<Self> {
        Some(Self::new(connection.hello().clone(), connection.client().events().ok()?))
    }

    /// Prints a line with date and slave for each event.
    pub fn print(&self, out: &mut dyn Write) -> std::io::Result<()> {
        let RecordedEvents { dropped, events } = &self.recorded;
        if events.is_empty() {
            return Ok(());
        }
        writeln!(out, "\nevents of {}", program(&self.hello))?;
        if *dropped > 0 {
            writeln!(out, "{dropped} earlier ones are not kept")?;
        }
        let style = if self.hello.is_free_running { Style::Date } else { Style::Absolute };
        let mut times = Timestamps::new(style, false);
        for RecordedEvent { time_ns, gateway, text, .. } in events {
            let time = times.text(*time_ns);
            let slave =
                gateway.map_or_else(String::new, |index| format!("{}: ", self.slave(index)));
            writeln!(out, "{time} {slave}{}", Printable(text))?;
        }
        Ok(())
    }

    /// Name of a gateway as it is configured; that of an earlier configuration may be another one.
    fn slave(&self, index: u16) -> String {
        match self.hello.gateways.get(usize::from(index)) {
            Some(Gateway { alias: 0, position, .. }) => format!("slave {position}"),
            Some(Gateway { alias, position: 0, .. }) => format!("slave with alias {alias}"),
            Some(Gateway { alias, position, .. }) => {
                format!("slave {position} after alias {alias}")
            }
            None => format!("gateway {index}"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pause_is_not_observed() {
        const MS: u64 = 1_000_000;
        let mut time = ObservedTime::start(5 * MS);
        for cycle in 1..=10 {
            time.advance((5 + cycle) * MS, MS);
        }
        assert_eq!(time.total_ns, 10 * MS);
        // The machine sleeps for an hour, and the clock is set back.
        time.advance(3_600_000 * MS, MS);
        assert_eq!(time.total_ns, 110 * MS);
        time.advance(MS, MS);
        time.advance(2 * MS, MS);
        assert_eq!(time.total_ns, 111 * MS);
        let mut status = StatusTime { total_ns: 0, images: 7 };
        status.advance(7, MS);
        status.advance(9, MS);
        assert_eq!(status.total_ns, 2 * MS);
        // The service has received images in a pause; then its counter starts again.
        status.advance(10_000, MS);
        status.advance(3, MS);
        assert_eq!(status.total_ns, 102 * MS);
        // A long period counts in full.
        time.advance(502 * MS, 500 * MS);
        assert_eq!(time.total_ns, 611 * MS);
    }
}
