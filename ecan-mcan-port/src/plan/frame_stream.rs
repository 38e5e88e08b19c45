//! The CAN frames that a plan is made for.

use ecan_protocol::can::CanFrame;

/// Destination of frames.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum FrameRoute {
    /// From the host through the gateway to the bus.
    ToBus,
    /// From the bus through the gateway to the host.
    FromBus,
    /// Between other nodes; filters keep it from the gateway. It only takes bus time.
    OnBusOnly,
}

/// Rate of a frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum FrameRate {
    /// Frames in every cycle.
    PerCycle(u32),
    /// One in every n-th cycle; 0 counts as 1.
    EveryCycles(u32),
    /// Frames per second on the average, evenly spread. Negative counts as none.
    PerSecond(f64),
}

impl FrameRate {
    /// Frames per cycle on the average.
    pub fn mean(self, cycle_ns: u32) -> f64 {
        match self {
            Self::PerCycle(frames) => frames.into(),
            Self::EveryCycles(cycles) => 1.0 / f64::from(cycles.max(1)),
            Self::PerSecond(frames) => frames.max(0.0) * f64::from(cycle_ns) / 1e9,
        }
    }

    /// Frames in the fullest cycle.
    pub fn peak(self, cycle_ns: u32) -> u32 {
        match self {
            Self::PerCycle(frames) => frames,
            Self::EveryCycles(_) => 1,
            Self::PerSecond(_) => self.mean(cycle_ns).ceil() as u32,
        }
    }
}

/// Frames of one kind on one channel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FrameStream {
    /// Slave index.
    pub slave: usize,
    /// Channel, 0..3.
    pub channel: u8,
    /// One of the frames: its format, kind of identifier and length count, nothing else.
    pub frame: CanFrame,
    /// Its rate.
    pub rate: FrameRate,
    /// Its destination.
    pub way: FrameRoute,
    /// Sent at a phase after Sync0, in nanoseconds, instead of at once (manual 8.4). Only for
    /// frames to the bus.
    pub schedule_offset_ns: Option<u32>,
}

impl FrameStream {
    /// Frames from the host to the bus, sent at once.
    pub fn to_bus(slave: usize, channel: u8, frame: CanFrame, rate: FrameRate) -> Self {
        Self { slave, channel, frame, rate, way: FrameRoute::ToBus, schedule_offset_ns: None }
    }

    /// Frames from the bus to the host.
    pub fn from_bus(slave: usize, channel: u8, frame: CanFrame, rate: FrameRate) -> Self {
        Self { way: FrameRoute::FromBus, ..Self::to_bus(slave, channel, frame, rate) }
    }

    /// The same, sent `offset_ns` after Sync0.
    #[must_use]
    pub fn scheduled(mut self, offset_ns: u32) -> Self {
        self.schedule_offset_ns = Some(offset_ns);
        self
    }

    /// Its offset, where it has one that counts.
    pub(super) fn offset_ns(&self) -> Option<u32> {
        self.schedule_offset_ns.filter(|_| self.way == FrameRoute::ToBus)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rates_have_a_mean_and_a_peak() {
        let both = |rate: FrameRate| (rate.mean(2_000_000), rate.peak(2_000_000));
        assert_eq!(both(FrameRate::PerCycle(3)), (3.0, 3));
        assert_eq!(both(FrameRate::EveryCycles(4)), (0.25, 1));
        assert_eq!(both(FrameRate::EveryCycles(0)), (1.0, 1));
        assert_eq!(both(FrameRate::PerSecond(750.0)), (1.5, 2));
        assert_eq!(both(FrameRate::PerSecond(-1.0)), (0.0, 0));
    }
}
