use ecan_protocol::can::{CanFrame, CanId, FrameKind};

use super::{Node, NodeOutput};
use crate::random::Random;

/// Faults of a [`FaultyNode`]. Without faults it is an echo node.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FaultyConfig {
    /// Frames without answer, per thousand.
    pub drop_permille: u16,
    /// Answers with one inverted data bit, per thousand.
    pub corrupt_permille: u16,
    /// Answers sent twice, per thousand.
    pub repeat_permille: u16,
    /// Interval in microseconds at which it sends a frame of the highest priority; 0 is never.
    pub babble_us: u32,
}

/// Echoes frames, but drops, corrupts or repeats some of them, and babbles.
///
/// Its answers have valid CRCs: the data is wrong. For frames that fail on the wire see
/// [`BusFault::ErrorFrames`](crate::BusFault::ErrorFrames).
#[derive(Clone, Debug)]
pub struct FaultyNode {
    config: FaultyConfig,
    random: Random,
    next_babble: Option<u64>,
    dropped: u64,
    corrupted: u64,
}

impl FaultyNode {
    /// A node with these faults. The same seed and the same frames give the same faults.
    #[must_use]
    pub const fn new(config: FaultyConfig, seed: u64) -> Self {
        Self { config, random: Random::new(seed), next_babble: None, dropped: 0, corrupted: 0 }
    }

    /// Number of frames without answer.
    #[must_use]
    pub const fn dropped(&self) -> u64 {
        self.dropped
    }

    /// Number of answers with wrong data.
    #[must_use]
    pub const fn corrupted(&self) -> u64 {
        self.corrupted
    }

    /// Inverts one data bit; a frame without data stays unchanged.
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
    fn try_clone(&self) -> Option<Box<dyn Node>> {
        Some(Box::new(self.clone()))
    }

    fn started(&mut self, now: u64, _out: &mut NodeOutput) {
        self.next_babble = (self.config.babble_us > 0).then_some(now);
    }

    fn received(&mut self, _now: u64, frame: &CanFrame, out: &mut NodeOutput) {
        if self.random.chance(self.config.drop_permille) {
            self.dropped += 1;
            return;
        }
        let response = if self.random.chance(self.config.corrupt_permille) {
            self.corrupt(frame)
        } else {
            *frame
        };
        out.send(response);
        if self.random.chance(self.config.repeat_permille) {
            out.send(response);
        }
    }

    fn next_event(&self) -> Option<u64> {
        self.next_babble
    }

    fn advance(&mut self, now: u64, out: &mut NodeOutput) {
        let Some(due) = self.next_babble.filter(|&due| due <= now) else {
            return;
        };
        let interval = u64::from(self.config.babble_us) * 1_000;
        // Missed intervals are not made up for, so the queue stays short.
        if out.is_empty()
            && let Some(frame) = babble()
        {
            out.send(frame);
        }
        let periods = (now - due) / interval + 1;
        self.next_babble = Some(due.saturating_add(periods.saturating_mul(interval)));
    }
}

/// Frame that wins every arbitration.
fn babble() -> Option<CanFrame> {
    CanFrame::classic(CanId::standard(0).ok()?, &[0xBB; 8]).ok()
}
