//! Time from one effective target of an axis to the next.

/// Target periods after which the drive has ended its last motion: with fewer, a target may still be
/// on the path to it.
const PAUSE_PERIODS: u64 = 4;

/// Counts the cycles since the last target took effect: with the first SYNC after it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct TargetPeriod {
    cycles: u32,
    ns: u64,
    /// A target was sent, but no SYNC after it.
    awaits_sync: bool,
    elapsed: u32,
    effective_ns: u64,
}

impl TargetPeriod {
    /// Creates the period of an axis without targets: the first one is due at once.
    pub(crate) fn new(cycles: u32, ns: u64) -> Self {
        Self { cycles, ns, awaits_sync: false, elapsed: u32::MAX, effective_ns: 0 }
    }

    pub(crate) fn ns(&self) -> u64 {
        self.ns
    }

    pub(crate) fn begin_cycle(&mut self) {
        self.elapsed = self.elapsed.saturating_add(1);
    }

    /// Returns whether a target takes effect a whole period after the last one, with a SYNC of this cycle.
    pub(crate) fn is_over(&self) -> bool {
        !self.awaits_sync && self.elapsed >= self.cycles
    }

    /// Whether targets were missed for so long, also by a pause of the cycle, that a drive that follows
    /// positions is certainly at rest.
    pub(crate) fn is_paused(&self, now_ns: u64) -> bool {
        let elapsed_ns = now_ns.saturating_sub(self.effective_ns);
        !self.awaits_sync && elapsed_ns > self.ns.saturating_mul(PAUSE_PERIODS)
    }

    pub(crate) fn target_sent(&mut self) {
        self.awaits_sync = true;
    }

    pub(crate) fn sync_sent(&mut self, now_ns: u64) {
        if std::mem::take(&mut self.awaits_sync) {
            self.elapsed = 0;
            self.effective_ns = now_ns;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn period_begins_with_the_sync_after_a_target() {
        let mut period = TargetPeriod::new(2, 200);
        assert!(period.is_over());
        period.target_sent();
        for _ in 0..5 {
            period.begin_cycle();
            assert!(!period.is_over(), "no SYNC yet");
        }
        period.sync_sent(1_000);
        period.begin_cycle();
        assert!(!period.is_over());
        period.sync_sent(1_100);
        period.begin_cycle();
        assert!(period.is_over(), "a SYNC without a target starts no period");
        assert!(!period.is_paused(1_800) && period.is_paused(1_801));
    }
}
