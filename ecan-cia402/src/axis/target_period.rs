//! Time from one effective target of an axis to the next.

/// Counts the cycles since the last target took effect: with the first SYNC after it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct TargetPeriod {
    cycles: u32,
    /// A target was sent, but no SYNC after it.
    awaits_sync: bool,
    elapsed: u32,
}

impl TargetPeriod {
    /// Creates the period of an axis without targets: the first one is due at once.
    pub(crate) fn new(cycles: u32) -> Self {
        Self { cycles, awaits_sync: false, elapsed: u32::MAX }
    }

    pub(crate) fn begin_cycle(&mut self) {
        self.elapsed = self.elapsed.saturating_add(1);
    }

    /// Whether a target takes effect a whole period after the last one, with a SYNC of this cycle.
    pub(crate) fn is_over(&self) -> bool {
        !self.awaits_sync && self.elapsed >= self.cycles
    }

    pub(crate) fn target_sent(&mut self) {
        self.awaits_sync = true;
    }

    pub(crate) fn sync_sent(&mut self) {
        if std::mem::take(&mut self.awaits_sync) {
            self.elapsed = 0;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn period_begins_with_the_sync_after_a_target() {
        let mut period = TargetPeriod::new(2);
        assert!(period.is_over());
        period.target_sent();
        for _ in 0..5 {
            period.begin_cycle();
            assert!(!period.is_over(), "no SYNC yet");
        }
        period.sync_sent();
        period.begin_cycle();
        assert!(!period.is_over());
        period.sync_sent();
        period.begin_cycle();
        assert!(period.is_over(), "a SYNC without a target starts no period");
    }
}
