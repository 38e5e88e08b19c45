//! Durations as C has them: 32-bit milliseconds.

use std::time::Duration;

pub(crate) fn duration(milliseconds: u32) -> Duration {
    Duration::from_millis(milliseconds.into())
}

/// Milliseconds of a duration, at most `u32::MAX`.
pub(crate) fn milliseconds(duration: Duration) -> u32 {
    u32::try_from(duration.as_millis()).unwrap_or(u32::MAX)
}
