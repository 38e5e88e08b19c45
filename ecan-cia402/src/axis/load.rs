//! How much of a CAN bus the process data take.

/// Bits of a classic frame with an 11-bit identifier and so many data bytes, interframe space
/// included: without a stuff bit, and with as many as are possible.
pub fn frame_bits(data_bytes: u32) -> (u32, u32) {
    let stuffed = 34 + 8 * data_bytes;
    let least = stuffed + 13;
    (least, least + (stuffed - 1) / 4)
}

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

/// What does not fit any more on a channel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LoadWarning {
    /// Even without a stuff bit the bus is too slow for the cycle: targets pile up, and the axes
    /// will hold.
    TooMuch,
    /// With unlucky data the bus is too slow for a cycle now and then.
    Tight,
    /// Less than a tenth is left for SDO, heartbeats and emergencies.
    NoReserve,
    /// More frames in a cycle than the gateway serves in one direction.
    Budget,
}

impl BusLoad {
    /// What does not fit, the worst first; `None` where there is room for everything.
    pub fn warning(&self) -> Option<LoadWarning> {
        if self.least > 1.0 {
            Some(LoadWarning::TooMuch)
        } else if self.frames_out > 8 || self.frames_in > 8 {
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

impl std::fmt::Display for LoadWarning {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::TooMuch => "the bus is too slow for this cycle",
            Self::Tight => "the bus may be too slow for some cycles",
            Self::NoReserve => "hardly any room is left for SDO, heartbeats and emergencies",
            Self::Budget => "more frames per cycle than the gateway serves",
        })
    }
}

/// Adds up one channel: data bytes of the RPDO of each axis, cycles from target to target and from
/// SYNC to SYNC, cycle time and bit rate.
pub(super) fn channel_load(
    (slave, channel): (usize, u8),
    rpdo_bytes: impl Iterator<Item = u32>,
    (target_cycles, sync_cycles): (u32, u32),
    cycle_ns: u32,
    bitrate: u32,
) -> BusLoad {
    let share = |bits: u32, cycles: u32| f64::from(bits) / f64::from(cycles.max(1));
    let mut load =
        BusLoad { slave, channel, axes: 0, frames_out: 1, frames_in: 0, least: 0.0, most: 0.0 };
    let mut add = |data_bytes, cycles| {
        let (least, most) = frame_bits(data_bytes);
        load.least += share(least, cycles);
        load.most += share(most, cycles);
    };
    add(0, sync_cycles);
    for bytes in rpdo_bytes {
        add(bytes, target_cycles);
        add(6, sync_cycles);
        load.axes += 1;
        load.frames_out += 1;
        load.frames_in += 1;
    }
    let bits_per_cycle = f64::from(bitrate.max(1)) * f64::from(cycle_ns) / 1e9;
    load.least /= bits_per_cycle;
    load.most /= bits_per_cycle;
    load
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_have_the_bits_that_the_standard_gives_them() {
        assert_eq!(frame_bits(0), (47, 55));
        assert_eq!(frame_bits(6), (95, 115));
        assert_eq!(frame_bits(8), (111, 135));
    }

    #[test]
    fn four_axes_at_one_kilohertz_fill_the_bus() {
        let load = channel_load((0, 1), [6; 4].into_iter(), (1, 1), 1_000_000, 1_000_000);
        assert_eq!(load.to_string(), "slave 0 channel 1: 4 axes, 81 to 98 % of the bus");
        assert_eq!(load.warning(), Some(LoadWarning::NoReserve));
        let load = channel_load((0, 1), [6; 4].into_iter(), (1, 1), 2_000_000, 1_000_000);
        assert_eq!(load.warning(), None, "at 500 Hz there is room");
        let load = channel_load((0, 1), [6; 5].into_iter(), (1, 1), 1_000_000, 1_000_000);
        assert_eq!(load.warning(), Some(LoadWarning::Tight));
        let load = channel_load((0, 1), [6; 6].into_iter(), (1, 1), 1_000_000, 1_000_000);
        assert_eq!(load.warning(), Some(LoadWarning::TooMuch));
        let load = channel_load((0, 1), [6; 8].into_iter(), (1, 1), 10_000_000, 1_000_000);
        assert_eq!(load.warning(), Some(LoadWarning::Budget));
    }
}
