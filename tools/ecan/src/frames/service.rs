//! Running gateways with their cycle, for the frame commands.

use std::fmt::Display;
use std::path::Path;

use ecan_command_line::interrupt::Interrupt;
use ecan_mcan_port::{PortError, SlaveStatistics};
use ecan_protocol::can::CanFrame;
use ecan_protocol::config::McanChannelConfig;
use ecan_protocol::image::ChannelStatus;
use ecan_protocol::mapping::{CHANNELS, Direction};

use crate::context::{Failure, Result, note};
use crate::frames::bit_rates::BitRates;
use crate::frames::capture::FrameCapture;
use crate::frames::channels::{Channels, can_config};
use crate::frames::link::{Arrival, BusFrame, Event, FrameLink, SessionState, Ticket};
use crate::frames::status_watch::StatusWatch;

/// Default depth of a channel's transmit cache (manual 13.8).
pub const CACHE_DEPTH: u32 = 64;

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
        let watched: Vec<_> = gateways.iter().map(|it| (it.position, it.channels)).collect();
        let watch = StatusWatch::new(&watched, link.as_ref());
        let (is_real_time, since_1970_ns) = (link.is_real_time(), link.since_1970_ns());
        let capture = capture.map(|it| it.with_time(is_real_time, since_1970_ns));
        Self { link, gateways, store: Vec::new(), watch, capture, interrupt }
    }

    pub fn begin(&mut self) -> Cycle {
        self.begin_with(|_| true)
    }

    /// As [`begin`](Self::begin); frames for which `accepts` is false are dropped, also from the
    /// capture.
    pub fn begin_with(&mut self, mut accepts: impl FnMut(&BusFrame) -> bool) -> Cycle {
        let mut arrivals = std::mem::take(&mut self.store);
        let now_ns = self.link.begin(&mut arrivals);
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
        self.gateways.get(gateway).map_or(0, |it| it.position)
    }

    /// Channels of the command on a gateway.
    pub fn channels(&self, gateway: usize) -> Channels {
        self.gateways.get(gateway).map_or(Channels::NONE, |it| it.channels)
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
        let cache = self.gateways.get(gateway).map_or(0, |it| it.cache_depth);
        u64::from(cache) + u64::from(controller)
    }

    pub fn session(&self, gateway: usize) -> SessionState {
        self.link.session(gateway)
    }

    /// Returns whether frames can be sent to a gateway.
    pub fn is_ready(&self, gateway: usize) -> bool {
        self.session(gateway).is_ready()
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
        let session = self.session(gateway);
        let reason = match session.is_ready() {
            true => format!("lost temporarily: {what}"),
            false => format!("lost, now {session}: {what}"),
        };
        Failure::NotReady { position: self.position(gateway), reason }
    }

    /// Text for missing frames of the only gateway, with the bit rates.
    pub fn silence(&self) -> String {
        let (counts, channels) = (self.statistics(0).channels, self.channels(0));
        if channels
            .iter()
            .any(|at| counts.get(usize::from(at)).is_some_and(|it| it.frames_received > 0))
        {
            return "no received frame passes the filters".to_owned();
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
            format!("{what}: channel {channel} has no data_bitrate in {}", path.display())
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
