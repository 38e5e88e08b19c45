//! Diagnostics of scheduled transmission, and the objects that contain them (manual 13.2.4, 13.2.5,
//! 13.7).

use ecan_protocol::mapping::CHANNELS;

const MAINTENANCE: u16 = 0xB000;
const FLAGS: u8 = 6;
const PERFORMANCE: u16 = 0x9011;
const DATA_PATH: u16 = 0x9020;

/// Index and subindex.
pub(crate) type Object = (u16, u8);

/// Counters of one channel, 0x9020..0x9023 (manual 13.2.5).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct ChannelDrops {
    /// Times that the controller's FIFO was full, :11.
    pub fifo_full: u32,
    /// Frames dropped as stale, :12.
    pub stale_drops: u32,
    /// Times that the channel went bus-off, :13.
    pub bus_offs: u32,
}

/// Diagnostics of scheduled transmission of a gateway.
///
/// Each reading contains the flags, `stale_drops` and `bus_offs`, and one of the other objects in turn.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct ScheduleDiagnostics {
    /// Legacy maintenance flags, 0xB000:06; they stay until they are cleared.
    pub flags: u16,
    /// Per channel; all 0 for one that is not enabled.
    pub channels: [ChannelDrops; CHANNELS],
    /// Sync0 pulses counted, 0x9011:02.
    pub sync0_count: u32,
    /// Smallest distance from a Sync0 pulse to the arrival of an image, in CPU cycles of the
    /// gateway (0x8000:04), 0x9011:04.
    pub phase_min_cycles: i32,
    /// Largest such distance, 0x9011:05.
    pub phase_max_cycles: i32,
    /// Longest service of scheduled frames, in CPU cycles, 0x9011:13.
    pub service_max_cycles: u32,
    /// Time at which the flags and counters that decide on frames were read, in nanoseconds of the
    /// library's clock.
    pub read_at_ns: u64,
}

impl ScheduleDiagnostics {
    /// Flag: a scheduled frame was dropped because its phase had passed (SCHED_LATE_DROP).
    pub const LATE_DROP: u16 = 1 << 6;
    /// Flag: a scheduled frame found the queue full (SCHED_QUEUE_FULL).
    pub const QUEUE_FULL: u16 = 1 << 7;
    /// Flag: the CAN controller rejected a scheduled frame at its phase (SCHED_TX_FAIL).
    pub const TX_FAIL: u16 = 1 << 8;
    /// Flag: the timer of scheduled transmission missed a phase (SCHED_TIMER_MISS).
    pub const TIMER_MISS: u16 = 1 << 9;
}

/// Objects that decide on frames: the flags, and of each channel `stale_drops` and `bus_offs`.
pub(crate) fn decisive_objects(channel_mask: u8) -> impl Iterator<Item = Object> {
    std::iter::once((MAINTENANCE, FLAGS)).chain(of_channels(channel_mask, &[12, 13]))
}

/// The other objects: `fifo_full` of each channel, and those of 0x9011.
pub(crate) fn other_objects(channel_mask: u8) -> impl Iterator<Item = Object> {
    of_channels(channel_mask, &[11]).chain([2, 4, 5, 13].map(|subindex| (PERFORMANCE, subindex)))
}

fn of_channels(channel_mask: u8, subindices: &'static [u8]) -> impl Iterator<Item = Object> {
    let enabled = (0..CHANNELS as u16).filter(move |channel| channel_mask >> channel & 1 == 1);
    enabled
        .flat_map(|channel| subindices.iter().map(move |subindex| (DATA_PATH + channel, *subindex)))
}

impl ScheduleDiagnostics {
    pub(crate) fn store(&mut self, object: Object, value: u32) {
        match object {
            (MAINTENANCE, _) => self.flags = value as u16,
            (PERFORMANCE, 2) => self.sync0_count = value,
            (PERFORMANCE, 4) => self.phase_min_cycles = value as i32,
            (PERFORMANCE, 5) => self.phase_max_cycles = value as i32,
            (PERFORMANCE, _) => self.service_max_cycles = value,
            (index, field) => {
                let channel = usize::from(index.wrapping_sub(DATA_PATH));
                let Some(channel) = self.channels.get_mut(channel) else { return };
                match field {
                    11 => channel.fifo_full = value,
                    12 => channel.stale_drops = value,
                    _ => channel.bus_offs = value,
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_object_has_its_own_field() {
        let decisive: Vec<_> = decisive_objects(0b1000).collect();
        assert_eq!(decisive, [(0xB000, 6), (0x9023, 12), (0x9023, 13)]);
        let other: Vec<_> = other_objects(0b1000).collect();
        assert_eq!(other, [(0x9023, 11), (0x9011, 2), (0x9011, 4), (0x9011, 5), (0x9011, 13)]);
        assert_eq!(decisive_objects(0x0F).chain(other_objects(0x0F)).count(), 17);
        let mut seen = ScheduleDiagnostics::default();
        for (value, object) in (100..).zip(decisive.into_iter().chain(other)) {
            seen.store(object, value);
        }
        let drops = ChannelDrops { stale_drops: 101, bus_offs: 102, fifo_full: 103 };
        let expected = ScheduleDiagnostics {
            flags: 100,
            channels: [
                ChannelDrops::default(),
                ChannelDrops::default(),
                ChannelDrops::default(),
                drops,
            ],
            sync0_count: 104,
            phase_min_cycles: 105,
            phase_max_cycles: 106,
            service_max_cycles: 107,
            read_at_ns: 0,
        };
        assert_eq!(seen, expected);
    }
}
