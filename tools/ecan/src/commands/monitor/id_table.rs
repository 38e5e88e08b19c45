//! Frames by gateway, channel, CAN ID and direction, in bounded memory.

use std::collections::BTreeMap;

use ecan_protocol::can::CanFrame;

use super::observation::ObservedFrame;
use super::snapshot::{Direction, IdView};

/// Most entries; frames of further CAN IDs are only counted.
pub const MAX_IDS: usize = 4096;
const MAX_DATA: usize = 64;

/// Gateway, channel, CAN ID with its format, direction.
type Key = (usize, u8, (bool, u32), Direction);

#[derive(Debug)]
struct Entry {
    frame: CanFrame,
    count: u64,
    last_ns: u64,
    /// Losses before the last frame.
    losses: u64,
    /// The last period, and the sum and number of all. A period across a loss is not known.
    period_ns: Option<u64>,
    periods_ns: u64,
    periods: u64,
    /// Time of the last change of each byte; 0 for none.
    changed_ns: [u64; MAX_DATA],
}

impl Entry {
    fn update(&mut self, frame: &ObservedFrame, losses: u64) {
        let ObservedFrame { time_ns, frame, .. } = *frame;
        let period_ns = time_ns.saturating_sub(self.last_ns);
        self.period_ns = (self.losses == losses).then_some(period_ns);
        if let Some(period_ns) = self.period_ns {
            self.periods_ns += period_ns;
            self.periods += 1;
        }
        for (at, (byte, changed_ns)) in frame.data().iter().zip(&mut self.changed_ns).enumerate() {
            if self.frame.data().get(at) != Some(byte) {
                *changed_ns = time_ns;
            }
        }
        (self.frame, self.last_ns, self.losses) = (frame, time_ns, losses);
        self.count += 1;
    }
}

#[derive(Debug, Default)]
pub struct IdTable {
    entries: BTreeMap<Key, Entry>,
    losses: u64,
    /// Frames of CAN IDs that found the table full.
    not_listed: u64,
}

impl IdTable {
    pub fn add(&mut self, frame: &ObservedFrame) {
        let id = frame.frame.id();
        let key = (frame.gateway, frame.channel, (id.is_extended(), id.raw()), frame.direction);
        if let Some(entry) = self.entries.get_mut(&key) {
            entry.update(frame, self.losses);
        } else if self.entries.len() < MAX_IDS {
            let entry = Entry {
                frame: frame.frame,
                count: 1,
                last_ns: frame.time_ns,
                losses: self.losses,
                period_ns: None,
                periods_ns: 0,
                periods: 0,
                changed_ns: [0; MAX_DATA],
            };
            self.entries.insert(key, entry);
        } else {
            self.not_listed += 1;
        }
    }

    /// Frames were lost: the periods across this point are not known.
    pub fn lose(&mut self) {
        self.losses += 1;
    }

    pub fn not_listed(&self) -> u64 {
        self.not_listed
    }

    /// Rows in the order of gateway, channel, CAN ID and direction, with the position of each gateway.
    /// Bytes that changed at or after `changed_since_ns` are marked.
    pub fn rows(&self, positions: &[usize], now_ns: u64, changed_since_ns: u64) -> Vec<IdView> {
        let row = |(key, entry): (&Key, &Entry)| {
            let (gateway, channel, _, direction) = *key;
            let is_recent = |ns: &u64| *ns != 0 && *ns >= changed_since_ns;
            let bytes = entry.changed_ns.iter().take(entry.frame.data().len()).enumerate();
            IdView {
                gateway: positions.get(gateway).copied().unwrap_or_default(),
                channel,
                direction,
                frame: entry.frame,
                count: entry.count,
                period_ns: entry.period_ns,
                mean_period_ns: entry.periods_ns.checked_div(entry.periods),
                age_ns: now_ns.saturating_sub(entry.last_ns),
                changed: bytes
                    .filter(|numbered| is_recent(numbered.1))
                    .fold(0, |set, (at, _)| set | 1 << at),
            }
        };
        self.entries.iter().map(row).collect()
    }
}

#[cfg(test)]
mod tests {
    use ecan_protocol::can::CanId;

    use super::*;

    fn frame(time_ns: u64, id: u32, data: &[u8]) -> ObservedFrame {
        let frame = CanFrame::classic(CanId::new(id, id > 0x7FF).unwrap(), data).unwrap();
        ObservedFrame { time_ns, gateway: 0, channel: 1, direction: Direction::Received, frame }
    }

    #[test]
    fn periods_are_those_between_frames_without_loss() {
        let mut table = IdTable::default();
        for time_ns in [100, 110, 130] {
            table.add(&frame(time_ns, 0x123, &[]));
        }
        let row = table.rows(&[4], 150, 0)[0];
        assert_eq!((row.gateway, row.channel, row.count, row.age_ns), (4, 1, 3, 20));
        assert_eq!((row.period_ns, row.mean_period_ns), (Some(20), Some(15)));
        table.lose();
        table.add(&frame(500, 0x123, &[]));
        let row = table.rows(&[4], 500, 0)[0];
        assert_eq!((row.period_ns, row.mean_period_ns), (None, Some(15)));
        table.add(&frame(530, 0x123, &[]));
        let row = table.rows(&[4], 530, 0)[0];
        assert_eq!((row.period_ns, row.mean_period_ns), (Some(30), Some(20)));
    }

    #[test]
    fn changed_bytes_are_marked_for_a_time() {
        let mut table = IdTable::default();
        for (time_ns, data) in [(10, &[1, 2, 3][..]), (20, &[1, 5, 3]), (30, &[1, 5, 3, 4])] {
            table.add(&frame(time_ns, 0x123, data));
        }
        let changed = |since_ns| table.rows(&[0], 30, since_ns)[0].changed;
        assert_eq!((changed(0), changed(21), changed(31)), (0b1010, 0b1000, 0));
        // Bytes beyond the end do not count.
        table.add(&frame(40, 0x123, &[1]));
        assert_eq!(table.rows(&[0], 40, 0)[0].changed, 0);
    }

    #[test]
    fn rows_are_ordered_and_formats_and_directions_are_separate() {
        let mut table = IdTable::default();
        table.add(&frame(1, 0x1234_5678, &[]));
        table.add(&frame(2, 0x123, &[]));
        table.add(&ObservedFrame { direction: Direction::Sent, ..frame(3, 0x123, &[]) });
        let rows = table.rows(&[0], 3, 0);
        let rows: Vec<_> = rows.iter().map(|row| (row.frame.id().raw(), row.direction)).collect();
        let (received, sent) = (Direction::Received, Direction::Sent);
        assert_eq!(rows, [(0x123, received), (0x123, sent), (0x1234_5678, received)]);
    }

    #[test]
    fn full_table_counts_frames_of_further_ids() {
        let mut table = IdTable::default();
        (0..MAX_IDS as u32 + 3).for_each(|at| table.add(&frame(1, 0x1000_0000 + at, &[])));
        table.add(&frame(2, 0x1000_0000, &[]));
        assert_eq!((table.rows(&[0], 2, 0).len(), table.not_listed()), (MAX_IDS, 3));
    }
}
