//! Answers of a drive to SYNC: missing ones show that targets may be lost.

/// SYNC periods without a TPDO after which the last target may be lost. With one, it may only be late.
const MISSED_PERIODS: u32 = 2;

/// Longest time in which the drive must show that it is at its last target.
const CHECK_NS: u64 = 500_000_000;

/// Watches whether the drive answered since the last target.
///
/// A gateway that is bus-off for a short time loses frames. If its images are lost at that time, too,
/// nothing reports this, but the TPDOs are missing. An axis that also got no target for some periods then
/// shows by its position whether the drive has its last target.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) struct AnswerWatch {
    /// Cycles without a TPDO.
    silent_cycles: u32,
    /// Too many, since the last target.
    has_missed: bool,
    /// Start of the check of the last target.
    check_since_ns: Option<u64>,
}

/// Result of a check of the last target.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum TargetCheck {
    /// The drive is not known to be at rest.
    Running,
    /// The drive is at its last target.
    Passed,
    /// It is not.
    Failed,
}

impl AnswerWatch {
    /// Once per cycle: whether it brought a TPDO.
    pub(crate) fn observe(&mut self, has_tpdo: bool, cycles_per_sync: u32) {
        self.silent_cycles = if has_tpdo { 0 } else { self.silent_cycles.saturating_add(1) };
        self.has_missed |= self.silent_cycles >= cycles_per_sync.saturating_mul(MISSED_PERIODS);
    }

    /// The axis does not follow targets.
    pub(crate) fn end_check(&mut self) {
        self.check_since_ns = None;
    }

    /// A target was sent.
    pub(crate) fn restart(&mut self) {
        self.has_missed = false;
        self.check_since_ns = None;
    }

    pub(crate) fn has_missed(&self) -> bool {
        self.has_missed
    }

    /// Returns whether a check of the last target runs; until its end no target is sent.
    pub(crate) fn is_checking(&self) -> bool {
        self.check_since_ns.is_some()
    }

    /// One cycle of the check. `is_there` states whether the drive is at its last target, `None` while it
    /// is not at rest.
    pub(crate) fn check(&mut self, is_there: Option<bool>, now_ns: u64) -> TargetCheck {
        let since_ns = *self.check_since_ns.get_or_insert(now_ns);
        let check = match is_there {
            Some(true) => TargetCheck::Passed,
            Some(false) => TargetCheck::Failed,
            None if now_ns.saturating_sub(since_ns) > CHECK_NS => TargetCheck::Failed,
            None => return TargetCheck::Running,
        };
        self.restart();
        check
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn after(answers: &[bool], cycles_per_sync: u32) -> AnswerWatch {
        let mut watch = AnswerWatch::default();
        answers.iter().for_each(|answer| watch.observe(*answer, cycles_per_sync));
        watch
    }

    #[test]
    fn two_periods_without_an_answer_are_missed() {
        for (answers, cycles_per_sync, is_missed) in [
            (&[true, false, true, false, true][..], 1, false),
            (&[true, false, false, true], 1, true),
            (&[true, false, false, false, true], 2, false),
            (&[true, false, false, false, false, true], 2, true),
        ] {
            let watch = after(answers, cycles_per_sync);
            assert_eq!(watch.has_missed(), is_missed, "{answers:?} {cycles_per_sync}");
        }
        let mut sent = after(&[false, false, true], 1);
        sent.restart();
        assert!(!sent.has_missed(), "the next target was sent");
    }

    #[test]
    fn check_waits_for_rest_and_ends_in_time() {
        let mut watch = after(&[false, false, true], 1);
        assert_eq!(watch.check(None, 100), TargetCheck::Running);
        assert!(watch.is_checking());
        assert_eq!(watch.check(Some(true), 200), TargetCheck::Passed);
        assert!(!watch.is_checking() && !watch.has_missed());
        assert_eq!(watch.check(Some(false), 300), TargetCheck::Failed);
        assert_eq!(watch.check(None, 400), TargetCheck::Running);
        assert_eq!(watch.check(None, 400 + CHECK_NS), TargetCheck::Running);
        assert_eq!(watch.check(None, 401 + CHECK_NS), TargetCheck::Failed);
    }
}
