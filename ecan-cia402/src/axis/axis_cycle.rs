//! One axis in the cycle: input to the guard, and the frame to send.

use ecan_canopen::{
    Command, Controlword, DriveState, Heartbeat, Network, NmtState, NodeStatus, OperatingMode,
    Statusword,
};
use ecan_mcan_port::{Backpressure, SendError, SendTicket, TransmitReport};

use super::axis::Axis;
use super::axis_state::AxisState;
use super::config::target_kind;
use super::pdo_layout::{CommandLayout, RpdoBytes};
use super::power::PowerGoal;
use super::procedure::Stage;
use super::ramp::Ramp;
use super::setup::{Reachability, SetupState};
use super::takeover::TakeoverState;
use super::target_path::TargetCheck;
use crate::guard::gateway_watch::GatewayWatch;
use crate::guard::terms::{
    ChannelView, Decision, DriveView, GuardInput, GuardState, HoldReason, TargetKind, WaitReason,
};

#[derive(Debug, Clone, Copy)]
pub(crate) struct Outgoing {
    pub(crate) rpdo: RpdoBytes,
    /// A command that stops or resets, instead of the target of the guard's decision.
    pub(crate) command: Option<Controlword>,
    /// The host's own ramp, if it makes the target.
    pub(crate) ramp: Option<Ramp>,
}

/// Whether a cycle carries targets of running axes.
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

impl Axis {
    // In

    pub(crate) fn begin_cycle(&mut self) {
        self.drive.arrived = None;
        self.target_period.begin_cycle();
    }

    /// Takes a TPDO, 0 is the first.
    pub(crate) fn take_tpdo(&mut self, nth: usize, data: &[u8]) {
        if nth == 0 {
            match CommandLayout::decode(data) {
                Some(feedback) => {
                    self.drive.arrived = Some(feedback);
                    self.statistics.tpdo_received();
                }
                None => self.statistics.malformed_tpdos += 1,
            }
        }
        if !(self.is_extended && self.setup.is_complete()) {
            return;
        }
        let further = &mut *self.further;
        if !further.layout.decode_inputs(nth, data, &mut further.inputs) {
            self.statistics.malformed_tpdos += u64::from(nth > 0);
        } else if further.probe_tpdo == Some(nth)
            && let Some(status) = further.inputs.probe_status()
        {
            further.probes.take(status);
        }
    }

    pub(crate) fn take_report(&mut self, report: &TransmitReport) {
        if let Some(ticket) = report.ticket
            && self.tickets.remove(ticket)
            && !report.code.is_success()
        {
            self.target_lost = true;
            self.statistics.targets_lost += 1;
        }
    }

    pub(crate) fn observe(&mut self, watch: &GatewayWatch, network: &Network, now_ns: u64) {
        let channel = self.config.address.channel;
        let actual = watch.actual(channel, self.drive.arrived.map(|feedback| feedback.position));
        self.statistics.observed(actual, self.drive.arrived.is_some());
        let was_in_fault = self.drive.is_in_fault();
        if self.setup.has_process_data() || matches!(self.setup, SetupState::SettingMode(_)) {
            self.drive.update(self.config.range, self.config.standstill, now_ns);
        }
        let target_lost = std::mem::take(&mut self.target_lost);
        let status = network.status(self.node);
        let input = GuardInput {
            path: watch.path(channel, target_lost),
            drive: self.drive_view(status.as_ref()),
            actual,
        };
        if self.has_auxiliary {
            self.further.is_path_clear = input.path.is_clear();
        }
        let before = std::mem::replace(&mut self.reachability, Reachability::of(&input));
        let may_have_restarted = if self.setup.is_running() {
            // The configuration itself ends Operational. A restart that the host does not see loses
            // the first steps.
            watch.lacks_image()
        } else {
            self.reachability.is_lost_since(before)
        };
        if may_have_restarted {
            self.require_verification();
        }
        let held = self.guard.observe(&input).or_else(|| self.check_last_target(&input, now_ns));
        if let Some(reason) = held {
            self.held(reason, now_ns);
        }
        if let Some(status) = status {
            if self.drive.arrived.is_some() || status.nmt_state.is_some() {
                self.appeared();
            }
            self.statistics.emergencies = status.emcy_count;
            self.check_restart(&status);
        }
        self.update_statistics();
        if self.drive.is_in_fault() && !was_in_fault {
            self.faulted(network, now_ns);
        }
    }

    /// Missing TPDOs, and no target for some periods: the drive must be at its last target before it gets
    /// another one, since the next would make the steps of those that were lost, too.
    fn check_last_target(&mut self, input: &GuardInput, now_ns: u64) -> Option<HoldReason> {
        self.answers.observe(self.drive.arrived.is_some(), self.cycles_per_sync);
        let Some(target) = self.target().filter(|_| self.answers.has_missed()) else {
            self.answers.end_check();
            return None;
        };
        let follows_positions = target_kind(self.mode) == TargetKind::Position;
        if !(follows_positions && self.target_period.is_paused(now_ns)) {
            return None;
        }
        let can_show = input.path.is_clear() && input.path.channel != ChannelView::NotSeen;
        let position = self.drive.arrived.map(|feedback| feedback.position);
        let is_there =
            position.filter(|_| can_show && self.drive_is_at_rest(now_ns)).map(|position| {
                let distance = self.config.range.distance(target, position).unsigned_abs();
                distance <= 2 * u64::from(self.config.standstill)
            });
        (self.answers.check(is_there, now_ns) == TargetCheck::Failed)
            .then(|| self.guard.lose_target())
    }

    fn drive_view(&self, status: Option<&NodeStatus>) -> DriveView {
        DriveView {
            state: self.drive.state,
            heartbeat_lost: status.is_some_and(|s| s.heartbeat == Heartbeat::TimedOut),
            not_operational: status.is_some_and(|s| self.is_not_operational(s)),
            unverified: !self.is_verified() || self.mode_due.is_some() && !self.is_running(),
            follows: !self.mode.is_cyclic() || self.drive.has(Statusword::MODE_12),
            following_error: self.mode == OperatingMode::CyclicPosition
                && self.drive.has(Statusword::MODE_13),
        }
    }

    /// A node with a heartbeat reports its state; of another one, and before the first heartbeat,
    /// only the last command is known.
    fn is_not_operational(&self, status: &NodeStatus) -> bool {
        let restarted = status.boot_ups != self.boot_ups;
        let state = match status.heartbeat {
            Heartbeat::Unconfigured | Heartbeat::Unknown => status.expected_nmt_state,
            Heartbeat::Active | Heartbeat::TimedOut => status.nmt_state,
        };
        restarted || state.is_some_and(|state| state != NmtState::Operational)
    }

    fn check_restart(&mut self, status: &NodeStatus) {
        if self.setup.is_complete() && status.boot_ups != self.boot_ups {
            self.restarted();
        }
        if self.setup == SetupState::Unconfigured {
            self.boot_ups = status.boot_ups;
            self.statistics.restart_tpdo_count();
        }
    }

    fn update_statistics(&mut self) {
        if self.drive.is_enabled() {
            let gap = self.guard.actual_age().min(u16::MAX - 1);
            self.statistics.longest_gap = self.statistics.longest_gap.max(gap);
        }
        if let (Some(target), Some(position)) = (self.target(), self.guard.actual())
            && target_kind(self.mode) == TargetKind::Position
        {
            let error = self.config.range.distance(target, position).unsigned_abs();
            self.statistics.max_following_error = self.statistics.max_following_error.max(error);
        }
    }

    // Out

    /// Returns the frame to send in this cycle. `stepping` makes the host's own steps, `turn` states
    /// whether this cycle carries targets. The actual position of an axis that is being enabled is
    /// sent back to it in the cycle that received it, whichever that is.
    pub(crate) fn prepare(
        &mut self,
        stepping: bool,
        turn: TargetTurn,
        repeats_commands: bool,
        now_ns: u64,
    ) -> Option<Outgoing> {
        self.decision = Decision::Closed;
        if let TakeoverState::Adopting(_) = self.takeover {
            return self.adoption_frame(repeats_commands);
        }
        let is_stopping = self.state.is_stopping() && self.setup.has_process_data();
        if !(self.setup.is_complete() || is_stopping) {
            return None;
        }
        let drive = self.drive.state;
        let command = self.state.controlword(drive, self.drive_is_at_rest(now_ns));
        let is_driven = self.state.power_goal() == PowerGoal::Enabled;
        if let Some(word) = command
            && (!is_driven || drive == Some(DriveState::QuickStopActive))
        {
            // The guard never delays it, and it moves nothing. Repeated in each short cycle, the commands of
            // several axes and their SYNC would occupy the bus.
            let target = self.guard.resting_target()?;
            let is_new = self.last_command != Some(word)
                || matches!(self.state, AxisState::ResettingFault(_));
            let rpdo = self.command_layout.encode(word, target, self.mode);
            return (is_new || repeats_commands).then_some(Outgoing {
                rpdo,
                command: Some(word),
                ramp: None,
            });
        }
        self.last_command = None;
        if !(is_driven || self.state == AxisState::Resuming) {
            return None;
        }
        if is_driven && self.coasts(now_ns)
            || self.has_auxiliary && self.awaits_end_of_feed_forward()
        {
            return None;
        }
        if let Some(reason) = self.delay(turn) {
            self.decision = Decision::Wait(reason);
            self.statistics.decided(self.decision, self.is_running());
            return None;
        }
        if self.is_running() && self.targets.waits_for_path() {
            self.decision = Decision::Wait(WaitReason::Together);
            self.statistics.decided(self.decision, true);
            return None;
        }
        self.rest_after_pause(now_ns);
        let (requested, ramp) = self.wanted_target(stepping);
        self.decision = self.guard.decide(requested);
        self.statistics.decided(self.decision, self.is_running());
        if self.decision == Decision::Wait(WaitReason::HoldsOldTarget) {
            self.old_target_found();
        }
        if matches!(self.decision, Decision::Reject(_)) && ramp.is_some() {
            // The host's own motion ends at a bound, or at a motor that does not follow.
            self.targets.stop();
        }
        let target = self.decision.target()?;
        let word = match self.decision {
            Decision::Track(_) => command?,
            _ => Controlword::of(Command::EnableOperation),
        };
        if matches!(self.decision, Decision::First(_)) {
            self.set_point.start(target);
        }
        let (bits, target) = self.mode_bits(target);
        let rpdo = self.command_layout.encode(word.with(bits), target, self.mode);
        Some(Outgoing { rpdo, command: None, ramp })
    }

    /// Returns whether a target of the axis is due.
    pub(crate) fn is_due(&self, turn: TargetTurn) -> bool {
        self.delay(turn).is_none()
    }

    /// The drive is off and its motor was not seen at rest: two positions of a short cycle do not show a
    /// slow motion.
    fn coasts(&self, now_ns: u64) -> bool {
        self.drive.state == Some(DriveState::SwitchOnDisabled)
            && !self.drive.rest.is_empty()
            && !self.drive_is_at_rest(now_ns)
    }

    /// Reason for which this cycle carries no target of an active axis.
    fn delay(&self, turn: TargetTurn) -> Option<WaitReason> {
        match (self.guard.state(), turn) {
            (GuardState::Armed { .. } | GuardState::Running { .. }, TargetTurn::NotReceived) => {
                Some(WaitReason::NotReceived)
            }
            (GuardState::Running { .. }, TargetTurn::NoSync) => Some(WaitReason::ImageUnconfirmed),
            (GuardState::Running { .. }, TargetTurn::NotDue) => Some(WaitReason::NotDue),
            (GuardState::Running { .. }, TargetTurn::Due) if !self.target_period.is_over() => {
                Some(WaitReason::NotDue)
            }
            (GuardState::Running { .. }, _) if self.answers.is_checking() => {
                Some(WaitReason::NoFreshPosition)
            }
            _ => None,
        }
    }

    /// An axis that rests since a pause is not moved at its last speed again.
    fn rest_after_pause(&mut self, now_ns: u64) {
        let follows_positions = target_kind(self.mode) == TargetKind::Position;
        if self.target_period.is_paused(now_ns) && follows_positions && !self.targets.is_in_path() {
            self.targets.stop();
        }
    }

    fn wanted_target(&self, stepping: bool) -> (Option<i32>, Option<Ramp>) {
        let Some(last) = self.target() else { return (None, None) };
        let own_step = stepping.then_some(self.config.target_step);
        self.targets.next(self.guard.limits(), last, own_step)
    }

    /// Bits of the controlword that belong to the mode, and the target to send with them.
    fn mode_bits(&mut self, target: i32) -> (u16, i32) {
        let halts = self.targets.is_halted && !self.mode.is_cyclic();
        let halt = if halts { Controlword::HALT } else { 0 };
        match self.mode {
            OperatingMode::ProfilePosition if self.drive.is_enabled() => {
                let acknowledged = self.drive.has(Statusword::MODE_12);
                let (bits, target) = self.set_point.step(target, acknowledged);
                (bits | halt, target)
            }
            OperatingMode::InterpolatedPosition if self.drive.is_enabled() => {
                (Controlword::MODE_4, target)
            }
            OperatingMode::Velocity if self.drive.is_enabled() => {
                let ramp = Controlword::MODE_4 | Controlword::MODE_5 | Controlword::MODE_6;
                (ramp | halt, target)
            }
            OperatingMode::Homing => {
                let stage = self.procedure.map(|procedure| procedure.stage);
                let is_started = matches!(stage, Some(Stage::Homing(_)));
                (if is_started { Controlword::MODE_4 } else { 0 }, target)
            }
            _ => (halt, target),
        }
    }

    pub(crate) fn sent(&mut self, outgoing: &Outgoing, ticket: SendTicket) {
        if let AxisState::ResettingFault(reset) = &mut self.state {
            reset.sent();
        }
        self.last_command = outgoing.command;
        if outgoing.command.is_some() {
            self.takeover.frame_sent();
            return;
        }
        let before = self.target();
        self.guard.sent();
        self.answers.restart();
        self.target_period.target_sent();
        self.tickets.insert(ticket);
        match self.decision {
            Decision::First(_) => self.activated(),
            Decision::Target(target) => {
                self.statistics.targets_sent += 1;
                // The host's ramp continues from any motion.
                let step = match target_kind(self.mode) {
                    TargetKind::Rate => target.into(),
                    _ => before.map_or(0, |before| self.config.range.distance(before, target)),
                };
                self.targets.sent(outgoing.ramp, step);
            }
            _ => {}
        }
    }

    /// After the decision of a cycle: a position axis for which a target was due, but not sent.
    pub(crate) fn count_gap(&mut self) {
        let is_missed = match self.decision {
            Decision::Wait(reason) => !matches!(reason, WaitReason::NotDue | WaitReason::Spent),
            Decision::Reject(_) => true,
            _ => false,
        };
        if is_missed && self.is_running() && self.guard.limits().kind == TargetKind::Position {
            self.targets.missed();
        }
    }

    /// The Port rejected the frame. Returns whether the channel's queue is full.
    pub(crate) fn not_sent(&mut self, outgoing: &Outgoing, error: &SendError) -> bool {
        match outgoing.command {
            None => self.skipped(),
            Some(_) => self.last_command = None,
        }
        matches!(error, SendError::Backpressure { what: Backpressure::Queue, .. })
    }

    /// Nothing can be sent in this cycle: a frame of this axis or of one before it on the channel
    /// was rejected, or an image is repeated.
    pub(crate) fn skipped(&mut self) {
        self.last_command = None;
        if self.decision.target().is_some() {
            self.decision = Decision::Wait(WaitReason::Rejected);
            self.statistics.decided(self.decision, self.is_running());
        }
        self.guard.rejected();
    }
}
