//! A running gateway with its cycle, for the frame commands.

use std::fmt::Display;
use std::path::Path;
use std::time::SystemTime;

use ecan_command_line::interrupt::Interrupt;
use ecan_command_line::real_time::RealTimeArguments;
use ecan_host::{AdapterConfig, Clock, Ecrt};
use ecan_mcan_port::{
    Port, PortConfig, PortError, Received, ReceivedFrame, SendError, SendTicket, Session,
};
use ecan_protocol::can::CanFrame;
use ecan_protocol::config::McanChannelConfig;
use ecan_protocol::mapping::CHANNELS;

use crate::context::{Failure, Result, note};
use crate::frames::arrival::Arrival;
use crate::frames::bit_rates::BitRates;
use crate::frames::capture::FrameCapture;
use crate::frames::channels::{Channels, can_config};
use crate::frames::single_gateway::{session, statistics};
use crate::frames::status_watch::StatusWatch;

const ARRIVALS: usize = 512;

/// Default depth of a channel's transmit cache (manual 13.8).
pub const CACHE_DEPTH: u32 = 64;

#[derive(Debug)]
pub struct GatewaySetup {
    pub position: usize,
    pub adapter: AdapterConfig,
    pub config: PortConfig,
    /// Channels whose changes are reported.
    pub channels: Channels,
}

#[derive(Debug)]
pub struct Cycle {
    /// Start time on the cycle clock, in nanoseconds.
    pub now_ns: u64,
    pub arrivals: Vec<Arrival>,
}

#[derive(Debug)]
pub struct Service {
    port: Port,
    /// Items received during startup, until the first cycle; later an empty buffer.
    store: Vec<Arrival>,
    watch: StatusWatch,
    channels: Channels,
    /// Offset from the cycle clock to the time since 1970; 0 for stepped time.
    since_1970_ns: u64,
    capture: Option<FrameCapture>,
    position: usize,
    /// Depth of the firmware's transmit cache per channel (0xF000:29).
    cache_depth: u32,
    interrupt: Interrupt,
}

impl Service {
    /// Starts a gateway; `None` if the user stops.
    pub fn start(
        ecrt: &Ecrt,
        setup: GatewaySetup,
        real_time: &RealTimeArguments,
        interrupt: &Interrupt,
    ) -> Result<Option<Self>> {
        let GatewaySetup { position, adapter, config, channels } = setup;
        let failed = |error| failure(position, error);
        if let Some(warning) = config.sync0_warning(&adapter) {
            note(format_args!("warning: {warning}"));
        }
        let mut port = Port::open(ecrt, (adapter, config)).map_err(failed)?;
        port.profile_warnings().iter().for_each(|warning| note(format_args!("warning: {warning}")));
        let clock = port.adapter().ecrt().clock().clone();
        let mut store = Vec::with_capacity(ARRIVALS);
        // `None` if the user stops.
        let ready: Result<(), Option<PortError>> =
            port.wait_ready_with(port.startup_timeout(), |port| {
                // Single cycles may fail; the timeout ends it all.
                let mut cycle = port.begin_cycle();
                let time_ns = clock.now_ns();
                let arrivals =
                    cycle.received().map(|item| Arrival { time_ns, received: item.to_owned() });
                store.extend(arrivals);
                drop(cycle);
                if interrupt.is_set() { Err(None) } else { Ok(()) }
            });
        match ready {
            Ok(()) => {}
            Err(None) => return Ok(None),
            Err(Some(error)) => return Err(failed(error)),
        }
        real_time.set_timing(port.adapter_mut());
        let watch = StatusWatch::new(channels, &port);
        let since_1970_ns = since_1970_ns(port.adapter().clock());
        Ok(Some(Self {
            port,
            store,
            watch,
            channels: Channels::ALL,
            since_1970_ns,
            capture: None,
            position,
            cache_depth: CACHE_DEPTH,
            interrupt: interrupt.clone(),
        }))
    }

    pub fn equip(&mut self, channels: Channels, cache_depth: u32, capture: Option<FrameCapture>) {
        let (is_real_time, since_1970_ns) = (self.is_real_time(), self.since_1970_ns);
        (self.channels, self.cache_depth) = (channels, cache_depth);
        self.capture = capture.map(|it| it.with_time(is_real_time, since_1970_ns));
    }

    pub fn begin(&mut self) -> Cycle {
        self.begin_with(|_| true)
    }

    /// As [`begin`](Self::begin); frames for which `accepts` is false are dropped, also from the
    /// capture.
    pub fn begin_with(&mut self, mut accepts: impl FnMut(&ReceivedFrame) -> bool) -> Cycle {
        let mut arrivals = std::mem::take(&mut self.store);
        let mut cycle = self.port.next_cycle();
        let now_ns = cycle.adapter().clock().now_ns();
        let items = cycle.received().map(|item| item.to_owned());
        arrivals.extend(items.map(|received| Arrival { time_ns: now_ns, received }));
        cycle.keep_open();
        arrivals.retain(|arrival| match &arrival.received {
            Received::Frame(frame) => self.channels.contains(frame.channel) && accepts(frame),
            Received::TransmitReport(_) => true,
        });
        if let Some(capture) = &mut self.capture {
            capture.after_begin(&self.port, now_ns, &arrivals);
        }
        Cycle { now_ns, arrivals }
    }

    /// Sends a frame; `None` without space in this cycle.
    pub fn send(&mut self, channel: u8, frame: &CanFrame) -> Result<Option<SendTicket>> {
        let Some(mut cycle) = self.port.open_cycle() else { return Ok(None) };
        let to = cycle.channel(0, channel).map_err(|error| Failure::Usage(error.to_string()))?;
        match cycle.send(to, frame) {
            Ok(ticket) => {
                if let Some(capture) = &mut self.capture {
                    capture.add_pending(ticket, channel, frame);
                }
                Ok(Some(ticket))
            }
            Err(error) if error.is_temporary() => Ok(None),
            Err(SendError::NotFd { .. }) => Err(without_fd("a CAN FD frame", channel, None)),
            Err(error) => Err(Failure::Usage(error.to_string())),
        }
    }

    /// Ends a cycle and reports bus changes on standard error. Fails if the capture cannot be
    /// written.
    pub fn end(&mut self, cycle: Cycle) -> Result {
        let ended = self.port.open_cycle().map_or(Ok(()), |open| open.end().map(drop));
        self.store = cycle.arrivals;
        self.store.clear();
        let now_ns = self.now_ns();
        if let Some(capture) = &mut self.capture {
            capture.after_end(&self.port, now_ns);
            if capture.is_over() {
                self.finish_capture()?;
            }
        }
        let say = comments(self.absolute_ns(cycle.now_ns));
        self.watch.look(&self.port, cycle.now_ns, say);
        ended.map_err(Failure::master)
    }

    /// Reports the remaining changes and finishes the capture.
    pub fn finish(&mut self) -> Result {
        self.watch.finish(&self.port, comments(self.absolute_ns(self.now_ns())));
        self.finish_capture()
    }

    fn finish_capture(&mut self) -> Result {
        self.capture.take().map_or(Ok(()), |capture| capture.finish())
    }

    /// Configuration of a channel; `None` if it is disabled.
    pub fn can(&self, channel: u8) -> Option<&McanChannelConfig> {
        can_config(&self.port, channel)
    }

    /// Maximum number of frames in a channel: firmware cache and CAN controller.
    pub fn capacity(&self, channel: u8) -> u64 {
        let controller = self.can(channel).map_or(0, |can| can.ram.tx_fifo_size);
        u64::from(self.cache_depth) + u64::from(controller)
    }

    pub fn not_ready(&self, what: &str) -> Failure {
        let reason = match session(&self.port) {
            Session::Ready => format!("lost temporarily: {what}"),
            session => format!("lost, now {session}: {what}"),
        };
        Failure::NotReady { position: self.position, reason }
    }

    /// Text for missing frames, with the bit rates.
    pub fn silence(&self) -> String {
        let counts = statistics(&self.port).channels;
        if self
            .channels
            .iter()
            .any(|at| counts.get(usize::from(at)).is_some_and(|it| it.frames_received > 0))
        {
            return "no received frame passes the filters".to_owned();
        }
        let channels = self.channels.iter();
        let mut rates: Vec<_> = channels
            .filter_map(|channel| Some((channel, BitRates::of(self.can(channel)?))))
            .collect();
        let is_alike = rates.windows(2).all(|pair| matches!(pair, [a, b] if a.1 == b.1));
        rates.truncate(if is_alike { 1 } else { CHANNELS });
        let message: Vec<_> = match is_alike {
            true => rates.iter().map(|(_, rates)| rates.to_string()).collect(),
            false => rates.iter().map(|(at, rates)| format!("{rates} on can{at}")).collect(),
        };
        format!("no frame received; check that the other nodes use {}", message.join(", "))
    }

    pub fn port(&self) -> &Port {
        &self.port
    }

    /// Returns whether the user has stopped the command.
    pub fn is_interrupted(&self) -> bool {
        self.interrupt.is_set()
    }

    pub fn port_mut(&mut self) -> &mut Port {
        &mut self.port
    }

    pub fn now_ns(&self) -> u64 {
        self.port.adapter().clock().now_ns()
    }

    /// Converts a time of the cycle clock to the time since 1970, or of a stepped simulation.
    pub fn absolute_ns(&self, time_ns: u64) -> u64 {
        time_ns.wrapping_add(self.since_1970_ns)
    }

    pub fn is_real_time(&self) -> bool {
        self.port.adapter().clock().is_free_running()
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

fn since_1970_ns(clock: &dyn Clock) -> u64 {
    if !clock.is_free_running() {
        return 0;
    }
    let since = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default();
    u64::try_from(since.as_nanos()).unwrap_or(0).wrapping_sub(clock.now_ns())
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
