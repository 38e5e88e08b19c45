//! The CAN frames that a plan is made for, and the time that they take on a bus.

use ecan_protocol::can::{CanFrame, FrameBits};
use ecan_protocol::config::McanChannelConfig;

/// The load of one channel by a set of frames.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ChannelLoad {
    /// Frames per cycle from the host on the average.
    pub mean_sent: f64,
    /// Frames per cycle to the host on the average.
    pub mean_received: f64,
    /// Frames from the host in the fullest cycle.
    pub peak_sent: u32,
    /// Frames to the host in the fullest cycle.
    pub peak_received: u32,
    /// Share of the bus without a stuff bit; 1 is all of it.
    pub least: f64,
    /// Share of the bus with as many stuff bits as are possible.
    pub most: f64,
}

impl ChannelLoad {
    /// Adds up the frames of one channel. No allocation.
    pub fn of<'a>(
        streams: impl IntoIterator<Item = &'a FrameStream>,
        can: &McanChannelConfig,
        cycle_ns: u32,
    ) -> Self {
        let mut load = Self::default();
        let cycle_s = f64::from(cycle_ns.max(1)) / 1e9;
        for stream in streams {
            let (mean, peak) = (stream.rate.mean(cycle_ns), stream.rate.peak(cycle_ns));
            match stream.way {
                FrameRoute::ToBus => {
                    load.mean_sent += mean;
                    load.peak_sent = load.peak_sent.saturating_add(peak);
                }
                FrameRoute::FromBus => {
                    load.mean_received += mean;
                    load.peak_received = load.peak_received.saturating_add(peak);
                }
                FrameRoute::OnBusOnly => {}
            }
            let share =
                |bits: FrameBits| mean * bits.seconds(can.nominal_bitrate, can.data_bitrate);
            load.least += share(FrameBits::least(stream.frame.as_ref())) / cycle_s;
            load.most += share(FrameBits::most(stream.frame.as_ref())) / cycle_s;
        }
        load
    }
}

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
    /// Rate of the frames.
    pub rate: FrameRate,
    /// Destination of the frames.
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

    /// Returns the stream with its frames sent `offset_ns` after Sync0.
    #[must_use]
    pub fn scheduled(mut self, offset_ns: u32) -> Self {
        self.schedule_offset_ns = Some(offset_ns);
        self
    }

    /// Offset of frames to the bus; `None` for frames that are sent at once or come from the bus.
    pub(super) fn offset_ns(&self) -> Option<u32> {
        self.schedule_offset_ns.filter(|_| self.way == FrameRoute::ToBus)
    }
}

#[cfg(test)]
mod tests {
    use ecan_protocol::can::{CanFrame, CanId};

    use super::*;
    use crate::FrameRate;

    fn id() -> CanId {
        CanId::standard(0x123).unwrap()
    }

    /// Five frames of 111 to 135 bits in 1000 bits.
    #[test]
    fn classic_frames_at_a_megabit() {
        let frame = CanFrame::classic(id(), &[0; 8]).unwrap();
        let streams = [
            FrameStream::to_bus(0, 0, frame, FrameRate::PerCycle(2)),
            FrameStream::from_bus(0, 0, frame, FrameRate::EveryCycles(2)),
            FrameStream {
                way: FrameRoute::OnBusOnly,
                ..FrameStream::to_bus(0, 0, frame, FrameRate::PerSecond(2_500.0))
            },
        ];
        let load = ChannelLoad::of(&streams, &McanChannelConfig::classic(1_000_000), 1_000_000);
        assert!((load.least - 0.555).abs() < 1e-9 && (load.most - 0.675).abs() < 1e-9, "{load:?}");
        assert_eq!((load.mean_sent, load.mean_received), (2.0, 0.5));
        assert_eq!((load.peak_sent, load.peak_received), (2, 1));
    }

    /// 64 bytes with bit rate switch: 29 to 32 bits at 500 kbit/s, 550 to 680 at 5 Mbit/s: 58 us
    /// and 110 us, 64 us and 136 us.
    #[test]
    fn fd_frames_count_in_both_phases() {
        let frame = CanFrame::fd(id(), &[0; 64], true, false).unwrap();
        let streams = [FrameStream::to_bus(0, 0, frame, FrameRate::PerCycle(1))];
        let can = McanChannelConfig::fd(500_000, 5_000_000);
        let load = ChannelLoad::of(&streams, &can, 1_000_000);
        assert!((load.least - 0.168).abs() < 1e-9 && (load.most - 0.2).abs() < 1e-9, "{load:?}");
    }

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
