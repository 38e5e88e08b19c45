//! Values of the bus at one time, in memory that is passed back and forth.

use ecan_host::CycleStart;
use ecan_mcan_port::{PendingStep, SlaveStatistics};
use ecan_protocol::can::CanFrame;
use ecan_protocol::image::ChannelStatus;
use ecan_protocol::mapping::CHANNELS;
use ecan_service::protocol::{AxisState, CycleState, SampledTimes, ServiceStats};

use super::bus_time::ChannelRates;
use super::snapshot::Direction;
use crate::frames::SessionState;

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

#[derive(Clone, Debug, Default)]
pub enum WaitingFor {
    #[default]
    Nothing,
    Step(PendingStep),
    Text(String),
}

impl WaitingFor {
    pub fn text(&self) -> Option<String> {
        match self {
            Self::Nothing => None,
            Self::Step(step) => Some(step.to_string()),
            Self::Text(text) => Some(text.clone()),
        }
    }
}

#[derive(Clone, Debug, Default)]
pub struct GatewayObservation {
    pub session: SessionState,
    pub waiting_for: WaitingFor,
    pub working_counter: u32,
    pub expected_working_counter: u32,
    pub statistics: SlaveStatistics,
    pub channels: [ChannelStatus; CHANNELS],
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
