//! A node that cannot be relied on.

use ecan_protocol::can::{CanFrame, FrameKind};

use super::{Node, NodeOutput};
use crate::random::Random;

/// What a [`FaultyNode`] does wrong. The default is nothing: it then behaves as an echo node.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FaultyConfig {
    /// Seed of its chance: the same seed and the same frames give the same faults.
    pub seed: u64,
    /// Of a thousand frames received, how many it does not answer.
    pub drop_per_mille: u16,
    /// Of a thousand answers, how many have one data bit turned over.
    pub corrupt_per_mille: u16,
    /// Of a thousand answers, how many are sent twice.
    pub repeat_per_mille: u16,
    /// A frame that it sends over and over without being asked.
    pub babble: Option<CanFrame>,
    /// Time between two of them in nanoseconds; 0 counts as 1.
    pub babble_interval_ns: u64,
}

/// Echoes frames, but loses, falsifies or repeats some of them, and babbles.
///
/// Its answers have valid CRCs: it is the data that is wrong. Frames that fail on the wire come
/// from [`BusFault::ErrorFrames`](crate::BusFault::ErrorFrames).
#[derive(Clone, Debug)]
pub struct FaultyNode {
    settings: FaultyConfig,
    random: Random,
    next_babble: Option<u64>,
    dropped: u64,
    corrupted: u64,
}

impl FaultyNode {
    /// A node with these faults.
    #[must_use]
    pub const fn new(settings: FaultyConfig) -> Self {
        Self {
            settings,
            random: Random::new(settings.seed),
            next_babble: None,
            dropped: 0,
            corrupted: 0,
        }
    }

    /// Frames received and not answered so far.
    #[must_use]
    pub const fn dropped(&self) -> u64 {
        self.dropped
    }

    /// Answers sent with wrong data so far.
    #[must_use]
    pub const fn corrupted(&self) -> u64 {
        self.corrupted
    }

    /// The frame with one data bit turned over; as it is when it has no data.
    fn corrupt(&mut self, frame: &CanFrame) -> CanFrame {
        let mut data = [0; 64];
        let bytes = frame.data();
        if bytes.is_empty() {
            return *frame;
        }
        let bit = self.random.below(8 * bytes.len() as u64) as usize;
        let Some(copy) = data.get_mut(..bytes.len()) else {
            return *frame;
        };
        copy.copy_from_slice(bytes);
        if let Some(byte) = copy.get_mut(bit / 8) {
            *byte ^= 1 << (bit % 8);
        }
        let changed = match frame.kind() {
            FrameKind::Fd { brs, esi } => CanFrame::fd(frame.id(), copy, brs, esi),
            FrameKind::Data | FrameKind::Remote => CanFrame::classic(frame.id(), copy),
        };
        self.corrupted += 1;
        // infallible: identifier and length come from a valid frame
        changed.unwrap_or(*frame)
    }
}

impl Node for FaultyNode {
    fn started(&mut self, now: u64, _out: &mut NodeOutput) {
        self.next_babble = self.settings.babble.map(|_| now);
    }

    fn received(&mut self, _now: u64, frame: &CanFrame, out: &mut NodeOutput) {
        if self.random.chance(self.settings.drop_per_mille) {
            self.dropped += 1;
            return;
        }
        let answer = if self.random.chance(self.settings.corrupt_per_mille) {
            self.corrupt(frame)
        } else {
            *frame
        };
        out.send(answer);
        if self.random.chance(self.settings.repeat_per_mille) {
            out.send(answer);
        }
    }

    fn next_event(&self) -> Option<u64> {
        self.next_babble
    }

    fn advance(&mut self, now: u64, out: &mut NodeOutput) {
        let Some(due) = self.next_babble.filter(|&due| due <= now) else {
            return;
        };
        let interval = self.settings.babble_interval_ns.max(1);
        if let Some(frame) = self.settings.babble {
            // A babbler floods the bus, not the memory: what is missed is not made up for.
            if out.is_empty() {
                out.send(frame);
            }
            let periods = (now - due) / interval + 1;
            self.next_babble = Some(due.saturating_add(periods.saturating_mul(interval)));
        }
    }
}
