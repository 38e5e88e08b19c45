//! Recovery from bus-off: 128 occurrences of 11 recessive bits.

/// Occurrences of eleven recessive bits that end the bus-off state.
const SEQUENCES: u64 = 128;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Recovery {
    missing: u64,
    /// Time since which the bus has been recessive for this recovery.
    recessive_since: u64,
    sequence_ns: u64,
}

impl Recovery {
    /// `sequence_ns` is the duration of 11 bits.
    pub(super) fn start(now: u64, sequence_ns: u64) -> Self {
        Self { missing: SEQUENCES, recessive_since: now, sequence_ns: sequence_ns.max(1) }
    }

    /// Time at which it ends if no frame is sent before.
    pub(super) fn end(&self) -> u64 {
        self.recessive_since + self.missing * self.sequence_ns
    }

    /// Handles a transmission that occupied the bus from `start`; it was recessive again from
    /// `quiet` on.
    pub(super) fn interrupted(&mut self, start: u64, quiet: u64) {
        let seen = start.saturating_sub(self.recessive_since) / self.sequence_ns;
        self.missing = self.missing.saturating_sub(seen);
        self.recessive_since = self.recessive_since.max(quiet);
    }
}
