//! Reference of the time stamps on candump's screen.

use core::str::FromStr;

/// Time stamps above this are times since 1970: 2001 is later, a recording of 30 years is shorter.
const LEAST_ABSOLUTE_NS: u64 = 1_000_000_000 * 1_000_000_000;
/// Share of decreasing time stamps from which they are differences: one in this number.
const DECREASING: usize = 10;

/// Reference of the time stamps on candump's screen, which the text does not state.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum ScreenTimes {
    /// Since 1970 (`candump -t a`).
    Absolute,
    /// Since the first frame (`candump -t z`).
    SinceFirst,
    /// Since the frame before (`candump -t d`).
    SincePrevious,
}

impl ScreenTimes {
    /// Decides by the time stamps in nanoseconds. The first one is absolute if it is in this century.
    /// Otherwise all are differences if one in ten is smaller than the one before it: times since the
    /// first frame decrease seldom. A few frames, or differences that only grow, count as times since
    /// the first frame.
    #[must_use]
    pub fn recognize(times_ns: &[u64]) -> Self {
        if times_ns.first().is_some_and(|first| *first >= LEAST_ABSOLUTE_NS) {
            return Self::Absolute;
        }
        let decreasing = times_ns.windows(2).filter(|it| it.first() > it.last()).count();
        match decreasing * DECREASING >= times_ns.len().max(1) {
            true => Self::SincePrevious,
            false => Self::SinceFirst,
        }
    }
}

impl FromStr for ScreenTimes {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        match text {
            "a" => Ok(Self::Absolute),
            "z" => Ok(Self::SinceFirst),
            "d" => Ok(Self::SincePrevious),
            _ => Err("expected a (since 1970), z (since the first frame) or d (delta)".to_owned()),
        }
    }
}
