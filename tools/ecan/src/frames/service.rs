//! From the options to a gateway in service, and the cycle that keeps it there.

use std::time::SystemTime;

use ecan_command_line::interrupt::Interrupt;
use ecan_command_line::real_time::RealTimeArguments;
use ecan_host::{AdapterConfig, Clock, CycleError, Ecrt};
use ecan_mcan_port::{Port, PortConfig, PortError, Received, ReceivedFrame, SendError, SendTicket};
use ecan_protocol::{CanFrame, McanChannelConfig};
use ecan_sim::ClockKind;

use crate::failure::Failure;
use crate::frames::capture::{CaptureOptions, FrameCapture};
use crate::frames::channels::Channels;
use crate::frames::settings::{Planned, Settings, Wishes};
use crate::frames::status_watch::StatusWatch;
use crate::global::GlobalOptions;
use crate::output::Output;

/// Cycles in a row that may fail.
pub const MAX_FAILED_CYCLES: u32 = 100;
/// Things that come back in a cycle, at first.
const ARRIVALS: usize = 512;

/// One gateway, and its configuration as the only one of a Port.
#[derive(Debug)]
pub struct Place {
    /// Its place in the ring.
    pub position: usize,
    /// The EtherCAT side.
    pub adapter: AdapterConfig,
    /// The CAN side.
    pub config: PortConfig,
    /// The channels of which changes are told.
    pub channels: Channels,
}

/// One thing that came back, and when.
#[derive(Clone, Copy, Debug)]
pub struct Arrival {
    /// Time of the clock in nanoseconds.
    pub time_ns: u64,
    /// What came back.
    pub received: Received,
}

/// A cycle between its beginning and its end.
#[derive(Debug)]
pub struct Cycle {
    /// When it began, on the clock, in nanoseconds.
    pub now_ns: u64,
    /// What came back.
    pub arrivals: Vec<Arrival>,
    begun: Result<(), CycleError>,
}

/// A gateway in service.
#[derive(Debug)]
pub struct Service {
    port: Port,
    /// What came back on the way into service, until the first cycle; then an empty store.
    store: Vec<Arrival>,
    watch: StatusWatch,
    /// The channels whose frames arrive.
    heard: Channels,
    failed_cycles: u32,
    /// From the clock to the time since 1970; none for simulated time that does not run by itself.
    since_1970_ns: u64,
    capture: Option<FrameCapture>,
    output: Output,
}

impl Service {
    /// Brings the gateway that the user chose into service, with a capture where one is wanted;
    /// `None` when the user gave up.
    pub fn open(
        settings: &Settings<'_>,
        capture: &CaptureOptions,
        wishes: Wishes,
        interrupt: &Interrupt,
        global: &GlobalOptions,
        output: &Output,
    ) -> Result<Option<Self>, Failure> {
        let kind = if wishes.has_end { ClockKind::Stepped } else { ClockKind::Real };
        let bus = settings.open_bus(global, output, kind)?;
        let Planned { positions, adapter, config, channels } =
            settings.for_one(&bus, wishes, global)?;
        let position = positions.first().copied().unwrap_or_default();
        config.check(&adapter).map_err(|faults| failure(position, faults.into()))?;
        // Before the real-time options: the thread that writes keeps out of what they ask for.
        let capture = FrameCapture::start(capture, &adapter, channels)?;
        let real_time = &settings.options().real_time;
        let granted = real_time.apply(|line| output.note(line));
        granted.map_err(|error| Failure::Host(error.to_string()))?;
        let place = Place { position, adapter, config, channels };
        let mut service = Self::start(bus.ecrt(), place, real_time, interrupt, output)?;
        if let Some(service) = &mut service {
            service.heard = channels;
            let (is_real_time, since_1970_ns) = (service.is_real_time(), service.since_1970_ns);
            service.capture = capture.map(|it| it.with_time(is_real_time, since_1970_ns));
        }
        Ok(service)
    }

    /// Brings a gateway into service on a bus that is open; `None` when the user gave up.
    pub fn start(
        ecrt: &Ecrt,
        place: Place,
        real_time: &RealTimeArguments,
        interrupt: &Interrupt,
        output: &Output,
    ) -> Result<Option<Self>, Failure> {
        let Place { position, adapter, config, channels } = place;
        let failed = |error| failure(position, error);
        let mut port = Port::open(ecrt, adapter, config).map_err(failed)?;
        let clock = port.adapter().ecrt().clock().clone();
        let mut store = Vec::with_capacity(ARRIVALS);
        let ready = port.wait_ready_with(port.startup_timeout_ms(), |port| {
            // Single cycles may fail; the timeout ends it all.
            let begun = port.cycle_begin();
            let time_ns = clock.now_ns();
            port.receive_each(|received| store.push(Arrival { time_ns, received }));
            let _ = port.cycle_end().and(begun);
            if interrupt.is_set() { Err(Stop::Interrupted) } else { Ok(()) }
        });
        match ready {
            Ok(()) => {}
            Err(Stop::Interrupted) => return Ok(None),
            Err(Stop::Failed(error)) => return Err(failed(error)),
        }
        real_time.set_timing(port.adapter_mut());
        let watch = StatusWatch::new(channels);
        let since_1970_ns = since_1970_ns(port.adapter().clock());
        let output = *output;
        Ok(Some(Self {
            port,
            store,
            watch,
            heard: Channels::ALL,
            failed_cycles: 0,
            since_1970_ns,
            capture: None,
            output,
        }))
    }

    /// Waits for the next cycle and begins it.
    pub fn begin(&mut self) -> Cycle {
        self.begin_with(|_| true)
    }

    /// As [`begin`](Self::begin), without the frames that `wants` refuses: they go into no capture
    /// either.
    pub fn begin_with(&mut self, mut wants: impl FnMut(&ReceivedFrame) -> bool) -> Cycle {
        self.port.wait_next_cycle();
        let begun = self.port.cycle_begin();
        let now_ns = self.now_ns();
        let mut arrivals = std::mem::take(&mut self.store);
        self.port.receive_each(|received| arrivals.push(Arrival { time_ns: now_ns, received }));
        arrivals.retain(|arrival| match &arrival.received {
            Received::Frame(frame) => self.heard.contains(frame.channel) && wants(frame),
            Received::TransmitReport(_) => true,
        });
        if let Some(capture) = &mut self.capture {
            capture.after_begin(&self.port, now_ns, &arrivals);
        }
        Cycle { now_ns, arrivals, begun }
    }

    /// Hands a frame over; `None` where there is no room in this cycle.
    pub fn send(&mut self, channel: u8, frame: &CanFrame) -> Result<Option<SendTicket>, Failure> {
        match self.port.send(0, channel, frame.as_ref()) {
            Ok(ticket) => {
                if let Some(capture) = &mut self.capture {
                    capture.under_way(ticket, channel, frame);
                }
                Ok(Some(ticket))
            }
            Err(SendError::NoRoom { .. } | SendError::NotReady { .. }) => Ok(None),
            Err(SendError::NotFd { .. }) => Err(Failure::Usage(format!(
                "channel {channel} carries no CAN FD frame: it has no data bit rate"
            ))),
            Err(error) => Err(Failure::Usage(error.to_string())),
        }
    }

    /// Ends a cycle. Says on standard error what has changed on the bus. A capture that cannot be
    /// written any more is a failure.
    pub fn end(&mut self, cycle: Cycle) -> Result<(), Failure> {
        let ended = self.port.cycle_end().and(cycle.begun);
        self.store = cycle.arrivals;
        self.store.clear();
        self.failed_cycles = if ended.is_err() { self.failed_cycles + 1 } else { 0 };
        let now_ns = self.now_ns();
        if let Some(capture) = &mut self.capture {
            capture.after_end(&self.port, now_ns);
            if capture.is_over() {
                self.finish_capture()?;
            }
        }
        let output = self.output;
        let (seconds, micros) = parts(self.absolute_ns(cycle.now_ns));
        self.watch.look(&self.port, |line| {
            output.note(format_args!("# ({seconds:010}.{micros:06}) {line}"));
        });
        match ended {
            Err(error) if self.failed_cycles > MAX_FAILED_CYCLES => {
                Err(Failure::Master(error.to_string()))
            }
            _ => Ok(()),
        }
    }

    /// Waits until the capture, if there is one, is written; says what was dropped.
    pub fn finish_capture(&mut self) -> Result<(), Failure> {
        self.capture.take().map_or(Ok(()), |capture| capture.finish(&self.output))
    }

    /// The configuration of a channel; none where it is not in service.
    pub fn can(&self, channel: u8) -> Option<&McanChannelConfig> {
        can(&self.port, channel)
    }

    pub fn port(&self) -> &Port {
        &self.port
    }

    pub fn port_mut(&mut self) -> &mut Port {
        &mut self.port
    }

    /// The clock of the cycle in nanoseconds.
    pub fn now_ns(&self) -> u64 {
        self.port.adapter().clock().now_ns()
    }

    /// A time of the clock as time since 1970, or as time of a stepped simulation.
    pub fn absolute_ns(&self, time_ns: u64) -> u64 {
        time_ns.wrapping_add(self.since_1970_ns)
    }

    /// Whether time goes on while nobody waits.
    pub fn is_real_time(&self) -> bool {
        self.port.adapter().clock().runs_by_itself()
    }
}

/// The configuration of a channel of the only gateway.
pub fn can(port: &Port, channel: u8) -> Option<&McanChannelConfig> {
    let gateway = port.config().gateways.first()?;
    gateway.channels.get(usize::from(channel))?.as_ref().map(|channel| &channel.can)
}

/// Seconds and microseconds.
fn parts(time_ns: u64) -> (u64, u64) {
    (time_ns / 1_000_000_000, time_ns / 1000 % 1_000_000)
}

fn since_1970_ns(clock: &dyn Clock) -> u64 {
    if !clock.runs_by_itself() {
        return 0;
    }
    let since = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default();
    u64::try_from(since.as_nanos()).unwrap_or(0).wrapping_sub(clock.now_ns())
}

/// The error of a gateway that is the only one of its Port.
pub fn failure(position: usize, error: PortError) -> Failure {
    match error {
        PortError::Config(faults) => Failure::Usage(faults.to_string()),
        PortError::Adapter(ecan_host::Error::Config(faults)) => Failure::Usage(faults.to_string()),
        PortError::Adapter(ecan_host::Error::Open(error)) => Failure::Master(error.to_string()),
        PortError::Cycle(error) => Failure::Master(error.to_string()),
        error => Failure::OutOfService { position, reason: error.to_string() },
    }
}

/// Why the way into service ended.
enum Stop {
    Interrupted,
    Failed(PortError),
}

impl From<PortError> for Stop {
    fn from(error: PortError) -> Self {
        Self::Failed(error)
    }
}
