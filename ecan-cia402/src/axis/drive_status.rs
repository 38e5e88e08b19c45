//! Latest status that a drive reported, by TPDO or SDO, and the SDO transfers that read it and stop the drive.

use ecan_canopen::{
    Configuring, Controlword, DriveState, Heartbeat, Network, NodeAccessError, NodeHandle, Sdo,
    SdoFault, Statusword, Step, StepFault, object,
};

use super::pdo_layout::Feedback;
use super::script::{Script, axis_script, first_index};
use super::status::HomingState;
use crate::guard::terms::PositionRange;

#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) struct DriveStatus {
    /// Newest TPDO of this cycle.
    pub(crate) arrived: Option<Feedback>,
    /// Last statusword, however old.
    pub(crate) statusword: Option<Statusword>,
    /// Last valid state, however old.
    pub(crate) state: Option<DriveState>,
    /// Time of the last statusword, from any source; `None` if the drive never reported one.
    pub(crate) heard_ns: Option<u64>,
    pub(crate) rest: RestDetector,
}

impl DriveStatus {
    /// Evaluates the TPDO of this cycle. `standstill` is the noise of an axis at rest.
    pub(crate) fn update(&mut self, range: PositionRange, standstill: u32, now_ns: u64) {
        if let Some(feedback) = self.arrived {
            self.store_statusword(feedback.statusword, now_ns);
            self.rest.observe(feedback.position, range, standstill, now_ns);
        }
    }

    pub(crate) fn store_statusword(&mut self, statusword: Statusword, now_ns: u64) {
        self.statusword = Some(statusword);
        self.state = statusword.state();
        self.heard_ns = Some(now_ns);
    }

    /// Forgets what the drive reported under another configuration; it remains known that it
    /// reported.
    pub(crate) fn forget(&mut self) {
        self.statusword = None;
        self.state = None;
    }

    pub(crate) fn is_fresh(&self, now_ns: u64, longest_ns: u64) -> bool {
        self.heard_ns.is_some_and(|heard| now_ns.saturating_sub(heard) <= longest_ns)
    }

    /// Returns whether positions not older than that show the axis at rest.
    pub(crate) fn is_at_rest(&self, now_ns: u64, longest_ns: u64) -> bool {
        self.rest.is_at_rest(now_ns, longest_ns)
    }

    pub(crate) fn has(&self, bits: u16) -> bool {
        self.statusword.is_some_and(|status| status.has(bits))
    }

    pub(crate) fn homing_state(&self) -> HomingState {
        self.statusword.map_or(HomingState::Waiting, HomingState::of)
    }

    pub(crate) fn is_enabled(&self) -> bool {
        self.state == Some(DriveState::OperationEnabled)
    }

    pub(crate) fn is_in_fault(&self) -> bool {
        self.state == Some(DriveState::Fault)
    }

    /// Returns whether the drive needs no command to be off. One that is switched on may have received the
    /// command to enable, and wait for its brake.
    pub(crate) fn is_off_or_unknown(&self) -> bool {
        self.is_off() || matches!(self.state, None | Some(DriveState::NotReadyToSwitchOn))
    }

    pub(crate) fn is_off(&self) -> bool {
        matches!(self.state, Some(DriveState::SwitchOnDisabled | DriveState::Fault))
    }
}

/// Returns whether the motor of a drive in this state has current.
pub(crate) fn is_energised(state: DriveState) -> bool {
    matches!(
        state,
        DriveState::OperationEnabled
            | DriveState::QuickStopActive
            | DriveState::FaultReactionActive
    )
}

/// Time for which the position must not leave the standstill window.
pub(crate) const REST_NS: u64 = 20_000_000;

/// Fewest positions in that time.
const SAMPLES: u16 = 3;

/// Most of that time that one position counts for: a host that was paused gets positions from before.
const MOST_NS: u64 = REST_NS / 2;

/// Detects that an axis is at rest: all positions of a time are within the standstill window.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) struct RestDetector {
    anchor: Option<i32>,
    rest_ns: u64,
    last_ns: u64,
    samples: u16,
}

impl RestDetector {
    pub(crate) fn observe(
        &mut self,
        position: i32,
        range: PositionRange,
        standstill: u32,
        now_ns: u64,
    ) {
        let is_near = self.anchor.is_some_and(|anchor| {
            range.distance(anchor, position).unsigned_abs() <= u64::from(standstill)
        });
        if is_near {
            self.samples = self.samples.saturating_add(1);
            let passed_ns = now_ns.saturating_sub(self.last_ns).min(MOST_NS);
            self.rest_ns = self.rest_ns.saturating_add(passed_ns);
        } else {
            *self = Self { anchor: Some(position), rest_ns: 0, last_ns: now_ns, samples: 1 };
        }
        self.last_ns = now_ns;
    }

    /// Starts over: earlier positions no longer count.
    pub(crate) fn restart(&mut self) {
        *self = Self::default();
    }

    pub(crate) fn position(&self) -> Option<i32> {
        self.anchor
    }

    /// Returns whether the last positions showed standstill, however old.
    pub(crate) fn was_at_rest(&self) -> bool {
        self.is_at_rest(self.last_ns, 0)
    }

    /// Returns whether no position was observed.
    pub(crate) fn is_empty(&self) -> bool {
        self.samples == 0
    }

    /// Returns whether the positions up to now show standstill; the last one must not be older than
    /// `longest_ns`.
    pub(crate) fn is_at_rest(&self, now_ns: u64, longest_ns: u64) -> bool {
        self.samples >= SAMPLES
            && self.rest_ns >= REST_NS
            && now_ns.saturating_sub(self.last_ns) <= longest_ns
    }
}

/// Attempts without an answer after which a drive counts as absent or gone: 800 ms.
pub(crate) const GONE_ATTEMPTS: u32 = 4;

/// Time for an answer before the request is repeated. A drive that was unreachable receives its stop
/// that soon after its return.
const RETRY_NS: u64 = 100_000_000;

/// Every n-th attempt waits longer, for a drive that is slow to answer.
const PATIENT_ATTEMPT: u32 = 4;
const PATIENT_NS: u64 = 500_000_000;

/// Content of a round.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Round {
    /// Writes the controlword, if there is one, then reads statusword and position.
    Stop(Option<Controlword>),
    /// Reads statusword and position.
    Inspect,
    /// Reads mode and quick stop option, too, and the object with the position that the drive keeps, in a position mode.
    InspectForAdoption(Option<u16>),
}

/// Repeats rounds of SDO transfers with a drive.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) struct DrivePoll {
    /// Axis of the node.
    axis: u8,
    round: Option<Script>,
    /// The round is a [`Round::Stop`].
    is_stop: bool,
    since_ns: u64,
    /// Attempts without an answer in a row.
    unanswered: u32,
    /// The last attempt had an answer.
    is_answered: bool,
    was_alive: bool,
}

impl DrivePoll {
    pub(crate) fn new(axis: u8) -> Self {
        Self { axis, ..Self::default() }
    }

    /// Returns whether a round runs.
    pub(crate) fn is_running(&self) -> bool {
        self.round.is_some()
    }

    pub(crate) fn unanswered(&self) -> u32 {
        self.unanswered
    }

    /// Returns whether the node answered the last round, be it by aborts.
    pub(crate) fn is_answered(&self) -> bool {
        self.is_answered
    }

    pub(crate) fn cancel(&mut self, network: &mut Network, node: NodeHandle) {
        if let Some(round) = self.round.take() {
            round.cancel(network, node);
        }
        self.unanswered = 0;
    }

    /// Continues the round, or begins the next one. Returns whether the drive answered a whole round,
    /// although it may lack some of the objects. `on_read` receives index and value.
    pub(crate) fn step(
        &mut self,
        network: &mut Network,
        node: NodeHandle,
        now_ns: u64,
        next: Round,
        mut on_read: impl FnMut(u16, u64),
    ) -> bool {
        let is_alive = network.heartbeat(node) == Heartbeat::Active;
        let returned = is_alive && !std::mem::replace(&mut self.was_alive, is_alive);
        let axis = self.axis;
        if matches!(next, Round::Stop(_))
            && !self.is_stop
            && let Some(round) = self.round.take()
        {
            // The response of an inspection may be lost; a stop does not wait for it.
            round.cancel(network, node);
        }
        let Some(round) = &mut self.round else {
            self.begin(network, node, now_ns, next);
            return false;
        };
        match round.advance(network, node, now_ns, |index, _, value| {
            on_read(first_index(axis, index), value);
        }) {
            Configuring::Done => self.note_answer(),
            Configuring::Running => {
                let waited_ns = now_ns.saturating_sub(self.since_ns);
                let is_patient = (self.unanswered + 1).is_multiple_of(PATIENT_ATTEMPT);
                let limit_ns = if is_patient && !returned { PATIENT_NS } else { RETRY_NS };
                if waited_ns > limit_ns {
                    round.cancel(network, node);
                    self.note_failure()
                } else {
                    false
                }
            }
            Configuring::Failed(failure) if is_abort(&failure.fault) => {
                // The object does not exist: the node is there, but it is not a drive.
                self.note_answer()
            }
            Configuring::Failed(_) => self.note_failure(),
        }
    }

    fn begin(&mut self, network: &mut Network, node: NodeHandle, now_ns: u64, round: Round) {
        if network.sdo_state(node) == Sdo::Busy {
            if !matches!(round, Round::Stop(_)) {
                return;
            }
            // A stop does not wait for a transfer of the application.
            network.cancel_sdo(node);
        }
        self.is_stop = matches!(round, Round::Stop(_));
        let read = |index| Step::read(index, 0);
        let status = [read(object::STATUSWORD), read(object::POSITION_ACTUAL).if_present()];
        self.round = Some(match round {
            Round::Stop(word) => {
                let write = |word: Controlword| Step::write(object::CONTROLWORD, 0, word.0);
                let word = word.map(|word| write(word).named("stop").if_accepted());
                axis_script(self.axis, word.into_iter().chain(status))
            }
            Round::Inspect => axis_script(self.axis, status),
            Round::InspectForAdoption(kept) => {
                let more =
                    [object::MODE_DISPLAY, object::QUICK_STOP_OPTION].into_iter().chain(kept);
                let more = more.map(|index| read(index).if_present());
                axis_script(self.axis, status.into_iter().chain(more))
            }
        });
        self.since_ns = now_ns;
    }

    fn note_answer(&mut self) -> bool {
        self.round = None;
        self.unanswered = 0;
        self.is_answered = true;
        true
    }

    fn note_failure(&mut self) -> bool {
        self.round = None;
        self.is_answered = false;
        self.unanswered = self.unanswered.saturating_add(1);
        false
    }
}

fn is_abort(fault: &StepFault) -> bool {
    matches!(fault, StepFault::Access(NodeAccessError::Sdo(SdoFault::Aborted(_))))
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
    /// TPDOs were missing for [`MISSED_PERIODS`] since the last target.
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
    /// The drive is not at its last target, or did not show it in time.
    Failed,
}

impl AnswerWatch {
    /// Counts a cycle without a TPDO. Call once per cycle.
    pub(crate) fn observe(&mut self, has_tpdo: bool, cycles_per_sync: u32) {
        self.silent_cycles = if has_tpdo { 0 } else { self.silent_cycles.saturating_add(1) };
        self.has_missed |= self.silent_cycles >= cycles_per_sync.saturating_mul(MISSED_PERIODS);
    }

    /// Ends the check, since the axis does not follow targets.
    pub(crate) fn end_check(&mut self) {
        self.check_since_ns = None;
    }

    /// Begins to count again, since a target was sent.
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

    const MS: u64 = 1_000_000;
    const LONGEST_NS: u64 = 100 * MS;

    /// Observes positions and returns whether the last one completes a standstill.
    fn observe(detector: &mut RestDetector, positions: &[i32], from_ms: u64, step_ms: u64) -> bool {
        let mut is_at_rest = false;
        for (nth, position) in (0_u64..).zip(positions) {
            let now_ns = (from_ms + nth * step_ms) * MS;
            detector.observe(*position, PositionRange::Linear, 20, now_ns);
            is_at_rest = detector.is_at_rest(now_ns, LONGEST_NS);
        }
        is_at_rest
    }

    #[test]
    fn noise_is_rest_after_its_time() {
        let mut detector = RestDetector::default();
        assert!(!observe(&mut detector, &[0, 5, -5, 9, -9], 0, 4), "16 ms");
        assert!(observe(&mut detector, &[3], 20, 4));
        assert!(!detector.is_at_rest(20 * MS + LONGEST_NS + 1, LONGEST_NS), "too old");
    }

    #[test]
    fn slow_motion_is_not_rest() {
        let mut detector = RestDetector::default();
        for nth in 0..200 {
            assert!(!observe(&mut detector, &[nth * 5], nth as u64, 1), "{nth} ms");
        }
    }

    #[test]
    fn positions_from_before_a_pause_are_not_rest() {
        let mut detector = RestDetector::default();
        assert!(!observe(&mut detector, &[0, 5, 10], 0, 1));
        assert!(!observe(&mut detector, &[15, 20], 200, 1), "one from before, one from after");
        assert!(observe(&mut detector, &[20; 9], 202, 1));
    }

    #[test]
    fn few_positions_are_not_rest() {
        let mut detector = RestDetector::default();
        assert!(!observe(&mut detector, &[0, 0], 0, 90));
        assert!(observe(&mut detector, &[0], 180, 1));
        detector.restart();
        assert!(!detector.is_at_rest(180 * MS, LONGEST_NS));
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
