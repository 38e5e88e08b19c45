//! Numbered frames: each party counts its own in the data, so that a lost or doubled one shows.

/// CAN IDs of the frames of the application and of the client on each channel.
pub const APPLICATION: u16 = 0x100;
pub const CLIENT: u16 = 0x200;

/// Frames of one party as an observer sees them: each one twice, when it is sent and as echo of the
/// node, in either order. Both kinds come in the order of their numbers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Sequence {
    /// Frames seen once and twice.
    pub once: u64,
    pub twice: u64,
}

impl Sequence {
    /// Takes a frame with this number; false if it is not a next one.
    pub fn take(&mut self, number: u64) -> bool {
        let is_second = number == self.twice && self.twice < self.once;
        let is_first = number == self.once;
        self.twice += u64::from(is_second);
        self.once += u64::from(is_first);
        is_first || is_second
    }

    /// All frames before this number were seen twice.
    pub fn before(number: u64) -> Self {
        Self { once: number, twice: number }
    }
}
