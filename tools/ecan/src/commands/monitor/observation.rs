//! What a source observes of the bus, in memory that is passed back and forth: cycles, gateways, frames, and the
//! error counters from the mailbox. A source is a cycle of this program, or the service of another one.

use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::time::Duration;

use ecan_host::{CycleStart, Diagnostics};
use ecan_mcan_port::{ChannelConfig, GatewayCondition, GatewayConfig, SlaveStatistics};
use ecan_protocol::can::{CanFrame, FrameBits};
use ecan_protocol::mapping::CHANNELS;
use ecan_service::protocol::{AxisState, CycleState, SampledTimes, ServiceStats};
use ecan_tool_support::diagnosis::registers::ErrorCounters;

use super::snapshot::{Direction, Errors};
use crate::context::{Failure, Result};
use crate::frames::ServiceEvents;

/// Interval of looking at the state of the gateways, in ns.
pub const LOOK_NS: u64 = 100_000_000;

const MARKS: usize = 4096;
const FRAMES: usize = 16_384;

/// The gateways of the observations that follow.
#[derive(Clone, Debug, Default)]
pub struct Layout {
    pub cycle_ns: u32,
    /// Counters of the cycle from which the view counts.
    pub base: CycleState,
    pub gateways: Vec<LayoutGateway>,
    /// Event to show, for a change while the command runs.
    pub event: Option<String>,
}

#[derive(Clone, Debug, Default)]
pub struct LayoutGateway {
    /// Position on the bus.
    pub position: usize,
    /// Counters from which the view counts.
    pub base: SlaveStatistics,
    pub rates: [ChannelRates; CHANNELS],
}

/// Start and end of a cycle.
#[derive(Clone, Copy, Debug)]
pub struct Mark {
    pub start: CycleStart,
    pub end_ns: u64,
}

/// State and times of a cycle of another program, of which it samples some.
#[derive(Clone, Debug)]
pub struct SampledCycle {
    pub cycle: CycleState,
    pub run_time: SampledTimes,
    pub late: SampledTimes,
}

#[derive(Clone, Copy, Debug, Default)]
pub struct GatewayObservation {
    pub condition: GatewayCondition,
    pub working_counter: u32,
    pub expected_working_counter: u32,
}

#[derive(Clone, Copy, Debug)]
pub struct ObservedFrame {
    pub time_ns: u64,
    /// Index of the gateway.
    pub gateway: usize,
    pub channel: u8,
    pub direction: Direction,
    pub frame: CanFrame,
}

#[derive(Clone, Copy, Debug)]
pub enum FrameItem {
    Frame(ObservedFrame),
    /// Number of frames that were lost at this point.
    Lost(u64),
}

/// Frames in order, in preallocated memory.
#[derive(Debug, Default)]
pub struct FrameBuffer {
    items: Vec<FrameItem>,
    lost_at_end: u64,
}

impl FrameBuffer {
    fn new() -> Self {
        Self { items: Vec::with_capacity(FRAMES), lost_at_end: 0 }
    }

    /// Adds a frame, or counts it as lost. Does not allocate.
    pub fn push(&mut self, frame: ObservedFrame) {
        self.add(FrameItem::Frame(frame), 1);
    }

    /// Counts lost frames. Does not allocate.
    pub fn lose(&mut self, count: u64) {
        self.add(FrameItem::Lost(count), count);
    }

    fn add(&mut self, item: FrameItem, frames: u64) {
        if self.items.len() < self.items.capacity() {
            self.items.push(item);
        } else {
            self.lost_at_end += frames;
        }
    }

    pub fn items(&self) -> impl Iterator<Item = FrameItem> {
        let lost = (self.lost_at_end > 0).then_some(FrameItem::Lost(self.lost_at_end));
        self.items.iter().copied().chain(lost)
    }

    pub fn is_nearly_full(&self) -> bool {
        self.items.len() >= FRAMES / 2
    }

    fn clear(&mut self) {
        self.items.clear();
        self.lost_at_end = 0;
    }
}

/// Values since the last observation.
#[derive(Debug, Default)]
pub struct Observation {
    /// On the clock of the frames.
    pub now_ns: u64,
    /// In the first observation, and after a change of the gateways.
    pub layout: Option<Layout>,
    /// Reason why the values are old.
    pub interruption: Option<&'static str>,
    /// Cycles, if each one is measured.
    pub marks: Vec<Mark>,
    /// Cycles that did not fit.
    pub unmeasured: u64,
    /// The cycle, if it is sampled.
    pub sampled: Option<SampledCycle>,
    pub gateways: Vec<GatewayObservation>,
    pub frames: FrameBuffer,
    pub axes: Vec<AxisState>,
    pub service: Option<ServiceStats>,
}

impl Observation {
    pub fn new(gateways: usize) -> Self {
        Self {
            marks: Vec::with_capacity(MARKS),
            gateways: vec![GatewayObservation::default(); gateways],
            frames: FrameBuffer::new(),
            ..Self::default()
        }
    }

    pub fn is_nearly_full(&self) -> bool {
        self.marks.len() >= MARKS / 2 || self.frames.is_nearly_full()
    }

    /// Clears the values and keeps the memory.
    pub fn clear(&mut self) {
        (self.layout, self.sampled) = (None, None);
        self.marks.clear();
        self.unmeasured = 0;
        self.frames.clear();
    }

    /// Records a cycle. Does not allocate.
    pub fn mark(&mut self, mark: Mark) {
        if self.marks.len() < self.marks.capacity() {
            self.marks.push(mark);
        } else {
            self.unmeasured += 1;
        }
    }
}

/// Bit rates of a channel in bit/s; 0 for a channel that is not enabled.
#[derive(Clone, Copy, Debug, Default)]
pub struct ChannelRates {
    nominal: u32,
    data: u32,
}

impl ChannelRates {
    pub fn of(gateway: &GatewayConfig) -> [Self; CHANNELS] {
        let channel = |channel: &Option<ChannelConfig>| {
            let Some(ChannelConfig { can, .. }) = channel else { return Self::default() };
            let nominal = can.nominal_bitrate;
            Self { nominal, data: if can.fd { can.data_bitrate } else { nominal } }
        };
        gateway.channels.each_ref().map(channel)
    }

    /// Shortest time of a frame on the bus, in seconds.
    pub fn seconds(self, frame: &CanFrame) -> f64 {
        if self.nominal == 0 {
            return 0.0;
        }
        FrameBits::least(frame.as_ref()).seconds(self.nominal, self.data)
    }
}

/// Error counters of one gateway; `None` if it does not respond.
pub type GatewayErrors = Option<[Errors; CHANNELS]>;

const PAUSE: Duration = Duration::from_millis(1000);

/// Objects of a channel (manual 13.5).
const INFORMATION: u16 = 0x9000;
const ERROR_COUNTERS: u8 = 1;
const DROPPED: u8 = 13;
const BUS_OFFS: u8 = 15;

/// Reads the error counters of a gateway's channels; `None` without a response. Blocks.
pub fn read_errors(diagnostics: &Diagnostics, slave: usize) -> GatewayErrors {
    let mut errors = [Errors::default(); CHANNELS];
    for (channel, index) in errors.iter_mut().zip(INFORMATION..) {
        let read = |subindex| diagnostics.sdo_upload_u32(slave, index, subindex).ok();
        let counters = ErrorCounters::from_raw(read(ERROR_COUNTERS)?);
        *channel = Errors {
            transmit: counters.transmit,
            receive: if counters.is_receive_passive { 128 } else { counters.receive },
            dropped: read(DROPPED)?.into(),
            bus_offs: read(BUS_OFFS)?.into(),
        };
    }
    Some(errors)
}

/// Reads the error counters of some gateways.
#[derive(Debug)]
pub struct ErrorReader {
    pub diagnostics: Diagnostics,
    /// Slave index of the handle and position of each gateway.
    pub slaves: Vec<(usize, usize)>,
}

impl ErrorReader {
    pub fn read(&self) -> impl Iterator<Item = (usize, GatewayErrors)> {
        let read = |(slave, position): &(usize, usize)| {
            (*position, read_errors(&self.diagnostics, *slave))
        };
        self.slaves.iter().map(read)
    }
}

/// Reads the error counters periodically. Not joined at the end: a lost slave may block the master.
pub struct Mailbox {
    _stop: Sender<()>,
}

impl Mailbox {
    pub fn start(reader: ErrorReader, errors: Sender<(usize, GatewayErrors)>) -> Result<Self> {
        let (stop, stopped) = channel::<()>();
        std::thread::Builder::new()
            .name("mailbox".to_owned())
            .spawn(move || {
                while stopped.recv_timeout(PAUSE) == Err(RecvTimeoutError::Timeout) {
                    if reader.read().any(|read| errors.send(read).is_err()) {
                        return;
                    }
                }
            })
            .map_err(Failure::of_thread)?;
        Ok(Self { _stop: stop })
    }
}

/// Origin of the observations.
#[derive(Clone, Debug, Default)]
pub struct Origin {
    pub is_simulated: bool,
    /// Program of the service, with version and process.
    pub program: Option<String>,
    /// Explanation for a bus without axes.
    pub without_axes: String,
}

/// Source of observations.
pub trait Source {
    fn origin(&self) -> Origin;

    /// Creates an observation for this source.
    fn observation(&self) -> Observation;

    /// Opens a reader of the error counters, for another thread.
    fn error_reader(&self) -> Result<ErrorReader>;

    /// Applies the settings of this thread, before the others have started.
    fn enter_thread(&mut self) -> Result;

    /// Starts; from now on [`observe`](Self::observe) must be called.
    fn start(&mut self) -> Result;

    /// Returns whether to wait longer for the gateways.
    fn is_starting(&self) -> bool;

    /// Waits for a short time and records what happens.
    fn observe(&mut self, observation: &mut Observation) -> Result;

    /// Records the state of the gateways.
    fn look(&mut self, observation: &mut Observation) -> Result;

    /// Clock for intervals.
    fn now_ns(&self) -> u64;

    /// Events that the service has recorded; `None` on the direct way.
    fn service_events(&self) -> Option<ServiceEvents> {
        None
    }

    /// Reads the error counters of all gateways, by position.
    fn read_errors(&mut self) -> Result<Vec<(usize, GatewayErrors)>>;
}

#[cfg(test)]
mod tests {
    use ecan_protocol::can::CanId;

    use super::*;

    #[test]
    fn full_frame_buffer_counts_losses_at_its_end() {
        let mut buffer = FrameBuffer::new();
        let frame = CanFrame::classic(CanId::standard(1).unwrap(), &[]).unwrap();
        let (time_ns, gateway, channel, direction) = (0, 0, 0, Direction::Received);
        let frame = ObservedFrame { time_ns, gateway, channel, direction, frame };
        let capacity = buffer.items.capacity();
        buffer.lose(5);
        (0..capacity).for_each(|_| buffer.push(frame));
        buffer.lose(7);
        assert_eq!((buffer.items.capacity(), buffer.items().count()), (capacity, capacity + 1));
        let lost: Vec<_> = buffer
            .items()
            .enumerate()
            .filter_map(|(at, item)| match item {
                FrameItem::Lost(count) => Some((at, count)),
                FrameItem::Frame(_) => None,
            })
            .collect();
        assert_eq!(lost, [(0, 5), (capacity, 8)]);
    }
}
