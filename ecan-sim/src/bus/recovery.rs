//! The way back from bus-off: 128 occurrences of 11 recessive bits.

use super::station::StationConfig;

/// Occurrences of eleven recessive bits that end the bus-off state.
const SEQUENCES: u64 = 128;

/// A recovery under way.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Recovery {
    missing: u64,
    /// Since when the bus has been recessive, as far as this recovery counts.
    recessive_since: u64,
    sequence_ns: u64,
}

impl Recovery {
    pub(super) fn start(now: u64, config: &StationConfig) -> Self {
        Self { missing: SEQUENCES, recessive_since: now, sequence_ns: config.bits_ns(11).max(1) }
    }

    /// When it ends if nothing is sent before.
    pub(super) fn end(&self) -> u64 {
        self.recessive_since + self.missing * self.sequence_ns
    }

    /// A transmission took the bus from `start`; it was recessive again from `quiet` on.
    pub(super) fn interrupted(&mut self, start: u64, quiet: u64) {
        let seen = start.saturating_sub(self.recessive_since) / self.sequence_ns;
        self.missing = self.missing.saturating_sub(seen);
        self.recessive_since = self.recessive_since.max(quiet);
    }
}
