//! Settings of node guarding.

use std::time::Duration;

/// Node guarding of a node: the host asks for its NMT state, and the node detects by the requests that the host
/// runs (life guarding). For nodes without heartbeat producer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct GuardingConfig {
    /// Time between two requests, 1 ms to 65535 ms, in whole milliseconds (0x100C).
    pub guard_time: Duration,
    /// The node, and the host, react after this multiple of the guard time without response or request, 1 to 255
    /// (0x100D).
    pub life_time_factor: u8,
}

impl GuardingConfig {
    /// Longest time between two valid responses: guard time times life time factor.
    pub fn life_time(&self) -> Duration {
        self.guard_time * u32::from(self.life_time_factor)
    }

    /// Returns whether guard time and factor are in range.
    pub fn is_valid(&self) -> bool {
        self.checked_ms().is_some()
    }

    /// Guard time in milliseconds; `None` if it or the factor is out of range.
    pub(super) fn checked_ms(&self) -> Option<u16> {
        let is_whole = self.guard_time.subsec_nanos().is_multiple_of(1_000_000);
        let ms = u16::try_from(self.guard_time.as_millis()).ok()?;
        (is_whole && ms > 0 && self.life_time_factor > 0).then_some(ms)
    }
}
