//! The process data of the axes as CAN frames, and how much of a bus they take.

use ecan_mcan_port::{ChannelLoad, FrameRate, FrameStream};
use ecan_protocol::can::{CanFrame, CanId};
use ecan_protocol::config::{DATA_PATH_BUDGET_MAX, McanChannelConfig};

use ecan_canopen::{MappingEntry, NodeAddress, SYNC_COB_ID, SyncConfig};

use super::table_config::Cia402Config;
use crate::axis::config::AxisConfig;
use crate::axis::pdo_layout::PdoLayout;

/// The load of one channel by the process data of its axes and SYNC; SDO, heartbeats and NMT need
/// what is left.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BusLoad {
    /// Slave index.
    pub slave: usize,
    /// Channel, 0..3.
    pub channel: u8,
    /// Axes on it.
    pub axes: u32,
    /// Frames from the host per cycle: targets and SYNC. A gateway serves 8 at most (0x8021:12).
    pub frames_out: u32,
    /// Frames from the drives per cycle: TPDOs. A gateway drains 8 at most (0x8021:05).
    pub frames_in: u32,
    /// Share of the bus without a stuff bit; 1 is all of it.
    pub least: f64,
    /// Share of the bus with as many stuff bits as are possible.
    pub most: f64,
}

ecan_protocol::text_enum! {
    /// Overload of a channel.
    pub enum LoadWarning;
    /// Even without a stuff bit the bus is too slow for the cycle: targets pile up, and the axes
    /// will hold.
    TooMuch = "the bus is too slow for this cycle";
    /// With unlucky data the bus is too slow for some cycles.
    Tight = "the bus may be too slow for some cycles";
    /// Less than a tenth is left for SDO, heartbeats and emergencies.
    NoReserve = "hardly any room is left for SDO, heartbeats and emergencies";
    Budget = "more frames per cycle than the gateway serves";
}

impl BusLoad {
    /// Overload, the worst first; `None` if everything fits.
    pub fn warning(&self) -> Option<LoadWarning> {
        if self.least > 1.0 {
            Some(LoadWarning::TooMuch)
        } else if self.frames_out.max(self.frames_in) > u32::from(DATA_PATH_BUDGET_MAX) {
            Some(LoadWarning::Budget)
        } else if self.most > 1.0 {
            Some(LoadWarning::Tight)
        } else if self.most > 0.9 {
            Some(LoadWarning::NoReserve)
        } else {
            None
        }
    }
}

/// `slave 0 channel 1: 4 axes, 81 to 98 % of the bus`
impl std::fmt::Display for BusLoad {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { slave, channel, axes, least, most, .. } = self;
        let name = if *axes == 1 { "axis" } else { "axes" };
        write!(f, "slave {slave} channel {channel}: {axes} {name}, ")?;
        write!(f, "{:.0} to {:.0} % of the bus", least * 100.0, most * 100.0)
    }
}

impl BusLoad {
    /// The load of a channel by the streams of its axes.
    pub(super) fn of(
        (slave, channel): (usize, u8),
        axes: u32,
        streams: &[FrameStream],
        can: &McanChannelConfig,
        cycle_ns: u32,
    ) -> Self {
        let here = || streams.iter().filter(|s| (s.slave, s.channel) == (slave, channel));
        let load = ChannelLoad::of(here(), can, cycle_ns);
        Self {
            slave,
            channel,
            axes,
            frames_out: load.peak_sent,
            frames_in: load.peak_received,
            least: load.least,
            most: load.most,
        }
    }
}

/// The process data of a table of axes as frames, for a
/// [`PortPlan`](ecan_mcan_port::PortPlan): target and TPDO of each axis, SYNC of each channel that
/// has one. SDO, heartbeats and NMT come on top. Needs no Port; allocates.
pub fn axis_traffic(axes: &[AxisConfig], config: &Cia402Config) -> Vec<FrameStream> {
    let layouts: Vec<PdoLayout> = axes.iter().map(AxisConfig::layout).collect();
    process_data(axes.iter().zip(&layouts), &config.sync, config.target_cycles(), None)
}

/// Process data of axes with these layouts, and targets that go out at an offset after Sync0.
pub(super) fn process_data<'a>(
    axes: impl Iterator<Item = (&'a AxisConfig, &'a PdoLayout)>,
    sync: &SyncConfig,
    target_cycles: u32,
    target_offset_ns: Option<u32>,
) -> Vec<FrameStream> {
    let (per_target, per_sync) =
        (FrameRate::EveryCycles(target_cycles), FrameRate::EveryCycles(sync.every_cycles.max(1)));
    let mut streams = Vec::new();
    let mut channels = Vec::new();
    for (axis, layout) in axes {
        let NodeAddress { slave, channel, .. } = axis.address;
        for nth in 0..layout.rpdo_count() {
            if let Some(frame) = frame(axis.rpdo_id(nth), bytes(layout.rpdo_entries(nth))) {
                let target = FrameStream::to_bus(slave, channel, frame, per_target);
                streams.push(FrameStream { schedule_offset_ns: target_offset_ns, ..target });
            }
        }
        for nth in 0..layout.tpdo_count() {
            if let Some(frame) = frame(axis.tpdo_id(nth), bytes(layout.tpdo_entries(nth))) {
                streams.push(FrameStream::from_bus(slave, channel, frame, per_sync));
            }
        }
        channels.push((slave, channel));
    }
    channels.sort_unstable();
    channels.dedup();
    let counter = usize::from(sync.counter_overflow.is_some());
    if let Some(frame) = frame(SYNC_COB_ID.can_id(), counter) {
        let schedule_offset_ns = sync.schedule.map(|schedule| schedule.offset_ns);
        streams.extend(channels.into_iter().map(|(slave, channel)| FrameStream {
            schedule_offset_ns,
            ..FrameStream::to_bus(slave, channel, frame, per_sync)
        }));
    }
    streams
}

fn bytes(entries: impl Iterator<Item = MappingEntry>) -> usize {
    entries.map(|entry| usize::from(entry.bits)).sum::<usize>() / 8
}

/// A frame of `length` zeros; none beyond eight, which no layout has.
fn frame(id: CanId, length: usize) -> Option<CanFrame> {
    CanFrame::classic(id, [0; 8].get(..length)?).ok()
}

#[cfg(test)]
mod tests {
    use super::*;
    use ecan_canopen::{NodeId, OperatingMode};

    const PLACE: (usize, u8) = (0, 1);

    fn axes(count: u8) -> Vec<AxisConfig> {
        let node = |n| NodeId::new(n).unwrap();
        (1..=count)
            .map(|n| AxisConfig::new(NodeAddress { slave: 0, channel: 1, node: node(n) }))
            .collect()
    }

    fn load(count: u8, cycle_us: u32) -> BusLoad {
        let streams = axis_traffic(&axes(count), &Cia402Config::default());
        let can = McanChannelConfig::classic(1_000_000);
        BusLoad::of(PLACE, count.into(), &streams, &can, cycle_us * 1_000)
    }

    /// Per axis 95 to 115 bits each way, SYNC 47 to 55: 807 to 975 of 1000.
    #[test]
    fn four_axes_at_one_kilohertz_fill_the_bus() {
        assert_eq!(load(4, 1_000).to_string(), "slave 0 channel 1: 4 axes, 81 to 98 % of the bus");
        assert_eq!(load(4, 1_000).warning(), Some(LoadWarning::NoReserve));
        assert_eq!(load(4, 2_000).warning(), None, "at 500 Hz there is room");
        assert_eq!(load(5, 1_000).warning(), Some(LoadWarning::Tight));
        assert_eq!(load(6, 1_000).warning(), Some(LoadWarning::TooMuch));
        assert_eq!(load(8, 10_000).warning(), Some(LoadWarning::Budget));
    }

    /// Torque targets are 4 bytes: 79 to 95 bits; a counter makes a SYNC 55 to 65 bits.
    #[test]
    fn layout_counter_and_divisors_count() {
        let torque = axes(1).into_iter().map(|a| a.with_mode(OperatingMode::CyclicTorque));
        let sync =
            SyncConfig { every_cycles: 2, counter_overflow: Some(10), ..SyncConfig::default() };
        let config = Cia402Config { sync, motion_div: 4, ..Cia402Config::default() };
        let streams = axis_traffic(&torque.collect::<Vec<_>>(), &config);
        let can = McanChannelConfig::classic(1_000_000);
        let load = BusLoad::of(PLACE, 1, &streams, &can, 1_000_000);
        let most = (95.0 / 4.0 + 115.0 / 2.0 + 65.0 / 2.0) / 1000.0;
        assert!((load.most - most).abs() < 1e-9, "{load}");
        assert_eq!((load.axes, load.frames_out, load.frames_in), (1, 2, 1));
    }
}
