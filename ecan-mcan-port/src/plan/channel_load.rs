//! Load of a CAN bus.

use ecan_protocol::can::FrameBits;
use ecan_protocol::config::McanChannelConfig;

use super::frame_stream::{FrameRoute, FrameStream};

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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::FrameRate;
    use ecan_protocol::can::{CanFrame, CanId};

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
}
