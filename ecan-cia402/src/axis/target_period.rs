//! Time from one effective target of an axis to the next.

/// Target periods after which the drive has ended its last motion: with fewer, a target may still be
/// on the path to it.
const PAUSE_PERIODS: u64 = 4;

/// Counts the cycles since the last target took effect: with the first SYNC after it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct TargetPeriod {
    cycles: u32,
    ns: u64,
    /// Cycles from a target to the SYNC that makes it effective: 0 if that follows in the same image, else the SYNC
    /// period.
    lead: u32,
    /// A target was sent, but no SYNC after it.
    awaits_sync: bool,
    elapsed: u32,
    effective_ns: u64,
}

impl TargetPeriod {
    /// Creates the period of an axis without targets: the first one is due at once.
    pub(crate) fn new(cycles: u32, ns: u64) -> Self {
        Self { cycles, ns, lead: 0, awaits_sync: false, elapsed: u32::MAX, effective_ns: 0 }
    }

    /// Returns this period for targets that take effect `lead` cycles after they were sent, with the next SYNC.
    pub(crate) fn with_lead(self, lead: u32) -> Self {
        Self { lead, ..self }
    }

    pub(crate) fn lead(&self) -> u32 {
        self.lead
    }

    pub(crate) fn ns(&self) -> u64 {
        self.ns
    }

    pub(crate) fn begin_cycle(&mut self) {
        self.elapsed = self.elapsed.saturating_add(1);
    }

    /// Returns whether a target of this cycle takes effect a whole period after the last one. With a lead, the
    /// SYNC of this cycle must have been sent before.
    pub(crate) fn is_over(&self) -> bool {
        !self.awaits_sync && self.elapsed.saturating_add(self.lead) >= self.cycles
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

    /// SYNC every 2 cycles, targets every 4.
    #[test]
    fn target_with_a_lead_takes_effect_with_the_next_sync() {
        let mut period = TargetPeriod::new(4, 400).with_lead(2);
        period.sync_sent(0);
        period.target_sent();
        for (cycle, has_sync, is_over) in
            [(1, false, false), (2, true, false), (3, false, false), (4, true, true)]
        {
            period.begin_cycle();
            if has_sync {
                period.sync_sent(cycle * 100);
            }
            assert_eq!(period.is_over(), is_over, "cycle {cycle}");
        }
        period.target_sent();
        period.begin_cycle();
        // The SYNC of the next period is late: the target waits for it.
        for _ in 0..6 {
            period.begin_cycle();
            assert!(!period.is_over());
        }
    }
}
