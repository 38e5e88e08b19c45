//! Due time of a periodic message.

use std::time::Duration;

/// Duration in nanoseconds, at most `u64::MAX`.
pub(super) fn nanoseconds(duration: Duration) -> u64 {
    u64::try_from(duration.as_nanos()).unwrap_or(u64::MAX)
}

/// Due time of a periodic message; the first one is due at once.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct PeriodTimer {
    due_ns: Option<u64>,
}

impl PeriodTimer {
    pub(super) fn is_due(&self, now_ns: u64) -> bool {
        self.due_ns.is_none_or(|due| now_ns >= due)
    }

    /// Keeps the period, of at least 1 ms; after a gap it restarts instead of catching up.
    pub(super) fn sent(&mut self, now_ns: u64, period: Duration) {
        let period = nanoseconds(period.max(Duration::from_millis(1)));
        let next = self.due_ns.map_or(now_ns, |due| due.saturating_add(period));
        self.due_ns = Some(if next > now_ns { next } else { now_ns.saturating_add(period) });
    }

    pub(super) fn reset(&mut self) {
        self.due_ns = None;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: u64 = 1_000_000;

    #[test]
    fn timer_keeps_its_period_without_catching_up() {
        let period = Duration::from_millis(10);
        let mut timer = PeriodTimer::default();
        assert!(timer.is_due(0));
        timer.sent(3 * MS, period);
        assert!(!timer.is_due(12 * MS));
        assert!(timer.is_due(13 * MS));
        timer.sent(14 * MS, period);
        assert!(timer.is_due(23 * MS), "a late cycle does not shift the plan");
        timer.sent(100 * MS, period);
        assert!(!timer.is_due(109 * MS));
        assert!(timer.is_due(110 * MS));
    }
}
