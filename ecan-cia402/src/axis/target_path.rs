//! Path of a target to the drive.

use ecan_canopen::Controlword;
use ecan_mcan_port::SendTicket;

/// Hands one position after the other to a drive in profile position mode.
///
/// The drive takes a position with the rising edge of controlword bit 4 and reports this by
/// statusword bit 12; only after both have fallen can the next be handed over.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct SetPoint {
    /// The position that the drive has taken, or that needs no taking.
    taken: Option<i32>,
    /// Bit 4 is up with this position.
    offered: Option<i32>,
}

impl SetPoint {
    /// The drive stands at `position` and need not be told to go there.
    pub fn start(&mut self, position: i32) {
        *self = Self { taken: Some(position), offered: None };
    }

    /// The bits of the controlword and the target for this cycle. `acknowledged` is statusword
    /// bit 12. Real-time safe.
    pub fn step(&mut self, requested: i32, acknowledged: bool) -> (u16, i32) {
        if let Some(offered) = self.offered {
            if !acknowledged {
                return (Controlword::MODE_4 | Controlword::MODE_5, offered);
            }
            self.taken = Some(offered);
            self.offered = None;
        } else if !acknowledged && self.taken != Some(requested) {
            self.offered = Some(requested);
            return (Controlword::MODE_4 | Controlword::MODE_5, requested);
        }
        (Controlword::MODE_5, self.taken.unwrap_or(requested))
    }

    /// Returns whether the drive has taken this position.
    pub fn has_taken(&self, position: i32) -> bool {
        self.taken == Some(position) && self.offered.is_none()
    }
}

/// Most pending results; older ones are forgotten.
const CAPACITY: usize = 8;

#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct TargetTickets {
    tickets: [Option<SendTicket>; CAPACITY],
    next: usize,
}

impl TargetTickets {
    pub(crate) fn insert(&mut self, ticket: SendTicket) {
        if let Some(slot) = self.tickets.get_mut(self.next) {
            *slot = Some(ticket);
        }
        self.next = (self.next + 1) % CAPACITY;
    }

    pub(crate) fn remove(&mut self, ticket: SendTicket) -> bool {
        let slot = self.tickets.iter_mut().find(|slot| **slot == Some(ticket));
        slot.is_some_and(|slot| slot.take().is_some())
    }
}

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

    const UP: u16 = 0x30;
    const DOWN: u16 = 0x20;

    #[test]
    fn position_is_offered_until_the_drive_accepts_it() {
        let mut point = SetPoint::default();
        point.start(5);
        assert_eq!(point.step(5, false), (DOWN, 5), "it is there");
        assert_eq!(point.step(900, false), (UP, 900));
        assert_eq!(point.step(900, false), (UP, 900));
        assert_eq!(point.step(900, true), (DOWN, 900));
        assert_eq!(point.step(900, true), (DOWN, 900));
        assert_eq!(point.step(900, false), (DOWN, 900));
        assert!(point.has_taken(900));
    }

    #[test]
    fn new_position_waits_for_the_handshake() {
        let mut point = SetPoint::default();
        point.start(0);
        assert_eq!(point.step(100, false), (UP, 100));
        assert_eq!(point.step(200, false), (UP, 100), "what is offered stays");
        assert_eq!(point.step(200, true), (DOWN, 100));
        assert_eq!(point.step(200, true), (DOWN, 100), "no edge while bit 12 is up");
        assert_eq!(point.step(200, false), (UP, 200));
    }

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
