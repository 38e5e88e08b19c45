//! Last emergency messages of one node (CiA 301, 7.2.7).

use crate::Emcy;

/// Emergency messages that are kept per node.
pub const EMCY_DEPTH: usize = 8;

/// Emergency message with its time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct EmcyRecord {
    /// Time of the cycle that received it, in nanoseconds of the bus clock.
    pub at_ns: u64,
    /// The message; error code 0 resets an error.
    pub emcy: Emcy,
}

/// Last emergency messages of one node.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct EmcyLog {
    records: [Option<EmcyRecord>; EMCY_DEPTH],
    count: u32,
    last_code: u16,
}

impl EmcyLog {
    pub(super) fn push(&mut self, at_ns: u64, emcy: Emcy) {
        let slot = self.count as usize % EMCY_DEPTH;
        if let Some(record) = self.records.get_mut(slot) {
            *record = Some(EmcyRecord { at_ns, emcy });
        }
        self.count = self.count.wrapping_add(1);
        self.last_code = emcy.code;
    }

    /// Error code of the last message; 0 before the first, or after the node reset its error.
    #[inline]
    pub fn last_code(&self) -> u16 {
        self.last_code
    }

    /// Number of messages, including those that reset an error.
    #[inline]
    pub fn count(&self) -> u32 {
        self.count
    }

    /// The last message.
    pub fn last(&self) -> Option<EmcyRecord> {
        self.recent().next()
    }

    /// The last [`EMCY_DEPTH`] messages, newest first.
    pub fn recent(&self) -> impl Iterator<Item = EmcyRecord> + '_ {
        (1..=EMCY_DEPTH as u32).map_while(|back| {
            let slot = self.count.wrapping_sub(back) as usize % EMCY_DEPTH;
            self.records.get(slot).copied().flatten()
        })
    }
}
