//! Path of a target of an axis from its source to the drive: decision, handshake, and result.

use ecan_canopen::{Controlword, OperatingMode, Statusword};
use ecan_mcan_port::{SendTicket, TransmitReport};

use super::config::target_kind;
use super::drive_link::DriveLink;
use super::drive_status::{AnswerWatch, DriveStatus, TargetCheck};
use super::pdo_layout::RpdoBytes;
use super::plan::AxisPlan;
use super::ramp::{FRACTION_BITS, Profile, Ramp, RampLimits};
use super::targets::TargetPeriod;
use super::targets::TargetSource;
use crate::guard::feed_forward::FeedForward;
use crate::guard::motion_guard::MotionGuard;
use crate::guard::terms::{
    ChannelView, Decision, GuardInput, GuardLimits, GuardState, HoldReason, TargetKind, WaitReason,
};

/// First RPDO of an axis in a cycle.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Outgoing {
    pub(crate) rpdo: RpdoBytes,
    /// A command that stops or resets, instead of the target of the guard's decision.
    pub(crate) command: Option<Controlword>,
    /// The host's own ramp, if it makes the target.
    pub(crate) ramp: Option<Ramp>,
}

/// Place of a cycle in the target period: whether the cycle carries targets of running axes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum TargetTurn {
    /// A target period begins in this cycle, and a SYNC follows.
    Due,
    NotDue,
    /// A target period begins, but the gateway's last image is unconfirmed, so that no SYNC is sent.
    NoSync,
    /// The status of the axes is not of this cycle.
    NotReceived,
}

/// Next step of an axis on the common path of a stop.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum PathStep {
    Ready,
    /// The axis gets no target in this cycle.
    Waits,
    /// The axis is no longer part of the stop, or cannot make the step.
    Left,
}

/// Feed-forward that a decision asks for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum FeedForwardStep {
    /// Follow the feed-forward of the target that is sent.
    Follow(Option<FeedForward>),
    /// Return to none by its changes, since the target is rejected.
    Return,
    /// No target can be sent in this cycle.
    Wait,
    /// End at once.
    End,
}

/// Path of the targets of an axis.
#[derive(Debug)]
pub(crate) struct TargetPath {
    /// Mode that the drive has confirmed, or that is being written.
    mode: OperatingMode,
    guard: MotionGuard,
    pub(crate) targets: TargetSource,
    set_point: SetPoint,
    answers: AnswerWatch,
    tickets: TargetTickets,
    /// The gateway reported a target as not sent since the last cycle.
    is_target_lost: bool,
    decision: Decision,
    period: TargetPeriod,
    /// Command that was sent last, unless a target was.
    last_command: Option<Controlword>,
}

impl TargetPath {
    pub(crate) fn new(
        mode: OperatingMode,
        limits: GuardLimits,
        ramp: RampLimits,
        period: TargetPeriod,
    ) -> Self {
        Self {
            mode,
            guard: MotionGuard::new(limits),
            targets: TargetSource::new(ramp),
            set_point: SetPoint::default(),
            answers: AnswerWatch::default(),
            tickets: TargetTickets::default(),
            is_target_lost: false,
            decision: Decision::Closed,
            period,
            last_command: None,
        }
    }

    pub(crate) fn mode(&self) -> OperatingMode {
        self.mode
    }

    pub(crate) fn follows_positions(&self) -> bool {
        target_kind(self.mode) == TargetKind::Position
    }

    /// Applies the rules of a mode, which the drive has confirmed or is about to.
    pub(crate) fn set_mode(&mut self, mode: OperatingMode, limits: GuardLimits) {
        self.mode = mode;
        self.guard.set_limits(limits);
    }

    /// Stores the mode of a drive that is to be adopted.
    pub(crate) fn expect_mode(&mut self, mode: OperatingMode) {
        self.mode = mode;
    }

    pub(crate) fn guard(&self) -> &MotionGuard {
        &self.guard
    }

    pub(crate) fn decision(&self) -> Decision {
        self.decision
    }

    pub(crate) fn period(&self) -> &TargetPeriod {
        &self.period
    }

    pub(crate) fn set_period(&mut self, period: TargetPeriod) {
        self.period = period;
    }

    pub(crate) fn target(&self) -> Option<i32> {
        match self.guard.state() {
            GuardState::Running { target } => Some(target),
            _ => None,
        }
    }

    pub(crate) fn is_running(&self) -> bool {
        self.target().is_some()
    }

    /// Returns whether the axis follows the application's targets.
    pub(crate) fn follows_application(&self) -> bool {
        self.is_running() && !self.targets.is_halted
    }

    /// Returns whether the application's targets can or do reach the drive.
    pub(crate) fn is_active(&self) -> bool {
        matches!(self.guard.state(), GuardState::Armed { .. } | GuardState::Running { .. })
    }

    pub(crate) fn is_at_rest(&self, drive: &DriveStatus) -> bool {
        self.target().is_none_or(|target| match target_kind(self.mode) {
            TargetKind::Position => self.targets.is_at_rest(),
            TargetKind::Rate => target == 0,
            // The drive generates its own motion, and reports its end.
            TargetKind::Profile => drive.has(Statusword::TARGET_REACHED),
            TargetKind::None => true,
        })
    }

    /// Returns whether a drive with its own trajectory has reached its target.
    pub(crate) fn is_target_reached(&self, drive: &DriveStatus) -> bool {
        let is_rejected = matches!(self.decision, Decision::Reject(_));
        if self.targets.requested.is_some_and(|new| self.target() != Some(new)) && !is_rejected {
            return false;
        }
        let has_taken = match self.mode {
            OperatingMode::ProfilePosition => {
                self.target().is_some_and(|target| self.set_point.has_taken(target))
            }
            mode => !mode.is_cyclic() && self.target().is_some(),
        };
        has_taken && drive.has(Statusword::TARGET_REACHED)
    }

    pub(crate) fn hold_reason(&self) -> Option<HoldReason> {
        match self.guard.state() {
            GuardState::Holding { reason } => Some(reason),
            _ => None,
        }
    }

    /// Starts to activate the axis at its actual position.
    pub(crate) fn activate(&mut self) {
        self.guard.activate();
    }

    /// Begins a running activation again: a position that was read before does not count.
    pub(crate) fn restart_activation(&mut self) {
        self.guard.restart_activation();
    }

    /// Ends targets: the axis is not active any more.
    pub(crate) fn release(&mut self) {
        self.guard.release();
    }

    /// Forgets all targets; the axis does not become active again by itself.
    pub(crate) fn stop_targets(&mut self) {
        self.guard.release();
        self.targets.clear();
    }

    /// Ends the targets for a stop of the drive. An axis that `holds` is not activated without a command.
    pub(crate) fn begin_stop(&mut self, holds: bool) {
        self.stop_targets();
        self.guard.begin_stop();
        if holds {
            self.guard.hold();
        }
    }

    /// Drops the targets of an axis that holds.
    pub(crate) fn drop_targets(&mut self) {
        self.targets.request(None, None);
        self.targets.stop();
    }

    // Input of a cycle

    pub(crate) fn begin_cycle(&mut self) {
        self.period.begin_cycle();
    }

    /// Evaluates a transmit report. Returns whether a target of the axis was not sent.
    pub(crate) fn on_report(&mut self, report: &TransmitReport) -> bool {
        let is_lost = report.ticket.is_some_and(|ticket| self.tickets.remove(ticket))
            && !report.code.is_success();
        self.is_target_lost |= is_lost;
        is_lost
    }

    /// Returns whether the gateway reported a target as not sent, once.
    pub(crate) fn take_lost_target(&mut self) -> bool {
        std::mem::take(&mut self.is_target_lost)
    }

    /// Passes the input of a cycle to the guard. Returns the reason if the axis begins to hold.
    #[inline]
    pub(crate) fn observe(
        &mut self,
        plan: &AxisPlan,
        link: &DriveLink,
        input: &GuardInput,
        now_ns: u64,
    ) -> Option<HoldReason> {
        self.guard.observe(input).or_else(|| self.check_last_target(plan, link, input, now_ns))
    }

    /// If TPDOs were missing and no target was sent for some periods, the drive must be at its last target before
    /// it gets another one, since the next would make the steps of those that were lost, too.
    #[inline]
    fn check_last_target(
        &mut self,
        plan: &AxisPlan,
        link: &DriveLink,
        input: &GuardInput,
        now_ns: u64,
    ) -> Option<HoldReason> {
        let arrived = link.drive().arrived;
        self.answers.observe(arrived.is_some(), plan.cycles_per_sync);
        let Some(target) = self.target().filter(|_| self.answers.has_missed()) else {
            self.answers.end_check();
            return None;
        };
        if !(self.follows_positions() && self.period.is_paused(now_ns)) {
            return None;
        }
        let can_show = input.path.is_clear() && input.path.channel != ChannelView::NotSeen;
        let position = arrived.map(|feedback| feedback.position);
        let is_there = position.filter(|_| can_show && link.is_at_rest(now_ns)).map(|position| {
            let distance = plan.config.range.distance(target, position).unsigned_abs();
            distance <= 2 * u64::from(plan.config.standstill)
        });
        (self.answers.check(is_there, now_ns) == TargetCheck::Failed)
            .then(|| self.guard.lose_target())
    }

    // Output of a cycle

    /// Begins the output of a cycle, without a target.
    pub(crate) fn close(&mut self) {
        self.decision = Decision::Closed;
    }

    /// Returns whether a command is sent in this cycle: it is a new one, or repetitions are due.
    pub(crate) fn must_send(&self, command: Controlword, repeats: bool) -> bool {
        repeats || self.last_command != Some(command)
    }

    /// Notes that the last command does not count as sent, so that it is sent again at once.
    pub(crate) fn forget_command(&mut self) {
        self.last_command = None;
    }

    /// Returns whether a target of the axis is due.
    pub(crate) fn is_due(&self, turn: TargetTurn) -> bool {
        self.delay(turn).is_none()
    }

    /// Reason for which this cycle carries no target of an active axis.
    fn delay(&self, turn: TargetTurn) -> Option<WaitReason> {
        match (self.guard.state(), turn) {
            (GuardState::Armed { .. } | GuardState::Running { .. }, TargetTurn::NotReceived) => {
                Some(WaitReason::NotReceived)
            }
            (GuardState::Running { .. }, TargetTurn::NoSync) => Some(WaitReason::ImageUnconfirmed),
            (GuardState::Running { .. }, TargetTurn::NotDue) => Some(WaitReason::NotDue),
            (GuardState::Running { .. }, TargetTurn::Due) if !self.period.is_over() => {
                Some(WaitReason::NotDue)
            }
            (GuardState::Running { .. }, _) if self.answers.is_checking() => {
                Some(WaitReason::NoFreshPosition)
            }
            _ => None,
        }
    }

    /// Decides about the target of a cycle. `own_step` is the step that the host is to make. Returns the
    /// host's own ramp, if it makes the target.
    #[inline]
    pub(crate) fn decide(
        &mut self,
        turn: TargetTurn,
        own_step: Option<i32>,
        now_ns: u64,
    ) -> Option<Ramp> {
        let reason = match self.delay(turn) {
            None if self.is_running() && self.targets.waits_for_path() => {
                Some(WaitReason::Together)
            }
            reason => reason,
        };
        if let Some(reason) = reason {
            self.decision = Decision::Wait(reason);
            return None;
        }
        self.rest_after_pause(now_ns);
        let (requested, ramp) = match self.target() {
            Some(last) => self.targets.next(self.guard.limits(), last, own_step),
            None => (None, None),
        };
        self.decision = self.guard.decide(requested);
        if matches!(self.decision, Decision::Reject(_)) && ramp.is_some() {
            // The host's own motion ends at a bound, or at a motor that does not follow.
            self.targets.stop();
        }
        ramp
    }

    /// An axis that rests since a pause is not moved at its last speed again.
    fn rest_after_pause(&mut self, now_ns: u64) {
        if self.period.is_paused(now_ns) && self.follows_positions() && !self.targets.is_in_path() {
            self.targets.stop();
        }
    }

    /// Bits of the controlword that belong to the mode, and the target to send with them. `is_homing` states
    /// whether the drive is to execute a homing.
    pub(crate) fn mode_bits(
        &mut self,
        target: i32,
        drive: &DriveStatus,
        is_homing: bool,
    ) -> (u16, i32) {
        if matches!(self.decision, Decision::First(_)) {
            self.set_point.start(target);
        }
        let halts = self.targets.is_halted && !self.mode.is_cyclic();
        let halt = if halts { Controlword::HALT } else { 0 };
        match self.mode {
            OperatingMode::ProfilePosition if drive.is_enabled() => {
                let acknowledged = drive.has(Statusword::MODE_12);
                let (bits, target) = self.set_point.step(target, acknowledged);
                (bits | halt, target)
            }
            OperatingMode::InterpolatedPosition if drive.is_enabled() => {
                (Controlword::MODE_4, target)
            }
            OperatingMode::Velocity if drive.is_enabled() => {
                let ramp = Controlword::MODE_4 | Controlword::MODE_5 | Controlword::MODE_6;
                (ramp | halt, target)
            }
            OperatingMode::Homing => (if is_homing { Controlword::MODE_4 } else { 0 }, target),
            _ => (halt, target),
        }
    }

    /// Notes a sent command.
    pub(crate) fn on_command_sent(&mut self, command: Controlword) {
        self.last_command = Some(command);
    }

    /// Notes a sent target.
    #[inline]
    pub(crate) fn on_target_sent(
        &mut self,
        plan: &AxisPlan,
        outgoing: &Outgoing,
        ticket: SendTicket,
    ) {
        self.last_command = None;
        let before = self.target();
        self.guard.sent();
        self.answers.restart();
        self.period.note_target();
        self.tickets.insert(ticket);
        match self.decision {
            Decision::First(_) => self.targets.stop(),
            Decision::Target(target) => {
                // The host's ramp continues from any motion.
                let step = match target_kind(self.mode) {
                    TargetKind::Rate => target.into(),
                    _ => before.map_or(0, |before| plan.config.range.distance(before, target)),
                };
                self.targets.note_sent(outgoing.ramp, step);
            }
            _ => {}
        }
    }

    /// Notes that nothing can be sent in this cycle. Returns whether a target was to be sent.
    pub(crate) fn skip(&mut self) -> bool {
        self.last_command = None;
        let has_target = self.decision.target().is_some();
        if has_target {
            self.decision = Decision::Wait(WaitReason::Rejected);
        }
        self.guard.rejected();
        has_target
    }

    /// Counts a target of a position axis that was due, but not sent. Call after the decision of a cycle.
    pub(crate) fn count_gap(&mut self) {
        let is_missed = match self.decision {
            Decision::Wait(reason) => !matches!(reason, WaitReason::NotDue | WaitReason::Spent),
            Decision::Reject(_) => true,
            _ => false,
        };
        if is_missed && self.is_running() && self.guard.limits().kind == TargetKind::Position {
            self.targets.note_gap();
        }
    }

    /// Notes a SYNC on the channel of the axis.
    pub(crate) fn note_sync(&mut self, now_ns: u64) {
        self.period.note_sync(now_ns);
    }

    /// Feed-forward that the decision of the cycle asks for. `is_own_motion` states whether the host made the
    /// target.
    pub(crate) fn take_feed_forward(&mut self, is_own_motion: bool) -> FeedForwardStep {
        match self.decision {
            Decision::Target(_) => {
                let has_effect = matches!(
                    self.mode,
                    OperatingMode::CyclicPosition | OperatingMode::CyclicVelocity
                );
                let requested = self.targets.feed_forward.take();
                FeedForwardStep::Follow(requested.filter(|_| has_effect && !is_own_motion))
            }
            Decision::Reject(_) => {
                self.targets.feed_forward = None;
                FeedForwardStep::Return
            }
            Decision::Wait(_) => FeedForwardStep::Wait,
            Decision::Track(_) | Decision::First(_) | Decision::Closed => {
                self.targets.feed_forward = None;
                FeedForwardStep::End
            }
        }
    }

    // Stop on a common path

    /// Largest rate in units per target.
    pub(crate) fn most_rate(&self) -> i128 {
        i128::from(self.guard.limits().step) << FRACTION_BITS
    }

    /// Returns whether the axis can make the next step of the common profile.
    pub(crate) fn path_step(&self, plan: &AxisPlan, common: Profile) -> PathStep {
        let next = self
            .target()
            .zip(self.targets.on_path(common))
            .and_then(|(last, ramp)| plan.config.range.add(last, ramp.step()));
        let Some(next) = next else { return PathStep::Left };
        match self.guard.evaluate(Some(next)) {
            Decision::Target(_) => PathStep::Ready,
            Decision::Wait(_) => PathStep::Waits,
            _ => PathStep::Left,
        }
    }
}

/// Hands one position after the other to a drive in profile position mode.
///
/// The drive takes a position with the rising edge of controlword bit 4 and reports this by
/// statusword bit 12; only after both have fallen can the next be handed over.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
struct SetPoint {
    /// The position that the drive has taken, or that needs no taking.
    taken: Option<i32>,
    /// Bit 4 is up with this position.
    offered: Option<i32>,
}

impl SetPoint {
    /// Begins with a drive that is at rest at `position`.
    fn start(&mut self, position: i32) {
        *self = Self { taken: Some(position), offered: None };
    }

    /// The bits of the controlword and the target for this cycle. `acknowledged` is statusword
    /// bit 12. Real-time safe.
    fn step(&mut self, requested: i32, acknowledged: bool) -> (u16, i32) {
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
    fn has_taken(&self, position: i32) -> bool {
        self.taken == Some(position) && self.offered.is_none()
    }
}

/// Most pending results; older ones are forgotten.
const CAPACITY: usize = 8;

#[derive(Debug, Clone, Copy, Default)]
struct TargetTickets {
    tickets: [Option<SendTicket>; CAPACITY],
    next: usize,
}

impl TargetTickets {
    fn insert(&mut self, ticket: SendTicket) {
        if let Some(slot) = self.tickets.get_mut(self.next) {
            *slot = Some(ticket);
        }
        self.next = (self.next + 1) % CAPACITY;
    }

    fn remove(&mut self, ticket: SendTicket) -> bool {
        let slot = self.tickets.iter_mut().find(|slot| **slot == Some(ticket));
        slot.is_some_and(|slot| slot.take().is_some())
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
}
