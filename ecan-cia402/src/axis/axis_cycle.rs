//! One axis in the cycle: what came in, what goes out.

use ecan_canopen::{
    Controlword, DriveState, Heartbeat, Network, NmtCommand, NmtState, NodeStatus, OperatingMode,
    Statusword,
};
use ecan_mcan_port::{Backpressure, SendError, SendTicket, TransmitReport};

use super::axis_core::{Axis, Motion, Reachability, Reverification, Setup};
use super::channel_watch::GatewayWatch;
use super::guard_input::{DriveView, GuardInput, HoldReason};
use super::guard_terms::{Decision, GuardState, TargetKind, WaitReason};
use super::pdo_layout::RpdoBytes;
use super::phase::AxisError;
use super::power::{PowerGoal, ResetState};
use super::procedure::Stage;
use super::settings::target_kind;

/// Pause between two NMT start commands to a node that does not report Operational; longer than
/// its heartbeat takes to show what became of the first.
const START_PAUSE_NS: u64 = 500_000_000;

/// How long a drive is told to switch off.
const DISABLE_NS: u64 = 30_000_000_000;

/// A frame that is to go out.
#[derive(Debug, Clone, Copy)]
pub(super) struct Outgoing {
    pub(super) rpdo: RpdoBytes,
    /// It carries the target of the guard's decision, not only a command.
    has_target: bool,
    /// The step that the host's own ramp makes with it.
    ramp_step: Option<i64>,
    commands: bool,
}

impl Axis {
    // In

    pub(super) fn begin_cycle(&mut self) {
        self.arrived = None;
    }

    /// A TPDO of this axis.
    pub(super) fn take_tpdo(&mut self, data: &[u8]) {
        match self.layout.decode(data) {
            Some(feedback) => {
                self.arrived = Some(feedback);
                self.statistics.tpdo_received();
            }
            None => self.statistics.malformed_tpdos += 1,
        }
    }

    /// The gateway says what became of a frame.
    pub(super) fn take_report(&mut self, report: &TransmitReport) {
        if let Some(ticket) = report.ticket
            && let Some(place) = self.tickets.iter_mut().find(|place| **place == Some(ticket))
        {
            *place = None;
            if !report.code.is_success() {
                self.target_lost = true;
                self.statistics.targets_lost += 1;
            }
        }
    }

    /// Everything of this cycle is in: the guard looks at it.
    pub(super) fn observe(&mut self, watch: &GatewayWatch, network: &Network) {
        let channel = self.settings.address.channel;
        let actual = watch.actual(channel, self.arrived.map(|feedback| feedback.position));
        self.statistics.observed(actual, self.arrived.is_some());
        let before = self.state;
        if let Some(feedback) = self.arrived {
            self.statusword = Some(feedback.statusword);
            self.state = feedback.statusword.state();
        }
        let target_lost = std::mem::take(&mut self.target_lost);
        let status = network.status(self.node);
        let input = GuardInput {
            way: watch.way(channel, target_lost),
            drive: self.drive_view(status.as_ref()),
            actual,
        };
        self.note_sight(&input);
        if let Some(reason) = self.guard.observe(&input) {
            self.held(reason);
        }
        if let Some(status) = status {
            self.statistics.emergencies = status.emcy_count;
            self.note_restart(&status);
        }
        if self.is_enabled() {
            let gap = self.guard.actual_age().min(u16::MAX - 1);
            self.statistics.longest_gap = self.statistics.longest_gap.max(gap);
        }
        if let (Some(target), Some(position)) = (self.target(), self.guard.actual())
            && target_kind(self.mode) == TargetKind::Position
        {
            let error = self.settings.range.distance(target, position).unsigned_abs();
            self.statistics.max_following_error = self.statistics.max_following_error.max(error);
        }
        if self.state == Some(DriveState::Fault) && before != self.state {
            self.note_fault(network);
        }
    }

    fn drive_view(&self, status: Option<&NodeStatus>) -> DriveView {
        let cyclic = self.mode.is_cyclic();
        DriveView {
            state: self.state,
            heartbeat_lost: status.is_some_and(|s| s.heartbeat == Heartbeat::TimedOut),
            not_operational: status.is_some_and(|s| self.is_not_operational(s)),
            unverified: self.doubt != Reverification::None,
            follows: !cyclic || self.has_status(Statusword::MODE_12),
            following_error: self.mode == OperatingMode::CyclicPosition
                && self.has_status(Statusword::MODE_13),
        }
    }

    /// A node that was heard says itself in which state it is; of another, and until the first
    /// heartbeat, only the last command is known.
    fn is_not_operational(&self, status: &NodeStatus) -> bool {
        let restarted = status.boot_ups != self.boot_ups;
        let state = match status.heartbeat {
            Heartbeat::Unconfigured | Heartbeat::Unknown => status.expected_nmt_state,
            Heartbeat::Active | Heartbeat::TimedOut => status.nmt_state,
        };
        restarted || state.is_some_and(|state| state != NmtState::Operational)
    }

    /// Doubt begins when the gateway, the heartbeat or the NMT state is lost: not while they stay
    /// lost, so that it can end.
    fn note_sight(&mut self, input: &GuardInput) {
        let sight = Reachability {
            in_service: input.way.in_service,
            heard: !input.drive.heartbeat_lost,
            operational: !input.drive.not_operational,
        };
        let before = std::mem::replace(&mut self.sight, sight);
        let is_lost = before.in_service && !sight.in_service
            || before.heard && !sight.heard
            || before.operational && !sight.operational;
        if is_lost {
            self.begin_doubt();
        }
    }

    pub(super) fn begin_doubt(&mut self) {
        if matches!(self.setup, Setup::Done) && matches!(self.doubt, Reverification::None) {
            self.doubt = Reverification::Open { from_ns: 0 };
        }
    }

    fn note_restart(&mut self, status: &NodeStatus) {
        if matches!(self.setup, Setup::Done) && status.boot_ups != self.boot_ups {
            self.forget_setup();
        }
        if matches!(self.setup, Setup::None) {
            self.boot_ups = status.boot_ups;
            self.statistics.restart_tpdo_count();
        }
    }

    /// The drive has forgotten its configuration: nothing that it says means what it meant.
    pub(super) fn forget_setup(&mut self) {
        self.rest();
        self.setup = Setup::None;
        self.doubt = Reverification::None;
        self.trouble = Some(AxisError::Restarted);
        self.power.set_goal(PowerGoal::None);
        self.procedure = None;
        self.state = None;
        self.statusword = None;
    }

    fn note_fault(&mut self, network: &Network) {
        self.statistics.faults += 1;
        let error_code = self.error_code(network);
        self.trouble = Some(AxisError::Fault { error_code });
        if self.power.goal() == PowerGoal::Enabled {
            self.rest_after_hold();
        }
    }

    pub(super) fn error_code(&self, network: &Network) -> u16 {
        let last = network.emcy(self.node).and_then(|log| log.last());
        last.map_or(0, |record| record.emcy.code)
    }

    /// The guard began to hold.
    fn held(&mut self, reason: HoldReason) {
        self.statistics.held(reason);
        if matches!(reason, HoldReason::TpdoLost(_)) {
            self.begin_doubt();
        }
        self.trouble = Some(AxisError::Held(reason));
        self.rest_after_hold();
        let stands = target_kind(self.mode) == TargetKind::Position;
        if self.settings.auto_take_up && stands && self.is_enabled() && is_of_the_way(reason) {
            self.guard.take_up();
            self.resumes = true;
        }
    }

    /// Nothing is commanded that could move the axis. A drive that makes its own way, or that
    /// would go on at its last velocity or torque, is stopped.
    fn rest_after_hold(&mut self) {
        self.wanted = None;
        self.ramp.stop();
        self.resumes = false;
        self.enabling_since_ns = None;
        let re_enables = std::mem::take(&mut self.re_enables);
        let rests = matches!(self.power.goal(), PowerGoal::Disabled | PowerGoal::QuickStopped);
        if rests && !re_enables {
            return;
        }
        let goal = match target_kind(self.mode) {
            TargetKind::Position => PowerGoal::None,
            _ if self.is_enabled() => PowerGoal::QuickStopped,
            _ => PowerGoal::None,
        };
        self.power.set_goal(goal);
    }

    /// Timeouts of commands, and an axis that takes itself up again.
    pub(super) fn step_commands(&mut self, network: &mut Network, now_ns: u64) {
        self.start_node(network, now_ns);
        if self.power.reset_state() == ResetState::Failed {
            let error_code = self.error_code(network);
            self.power.set_goal(PowerGoal::None);
            self.trouble = Some(AxisError::ResetRefused { error_code });
        }
        if self.resumes && !self.is_enabled() {
            // It left Operation Enabled meanwhile: enabling is the application's command.
            self.resumes = false;
            self.guard.release();
        }
        self.give_up_disabling(now_ns);
        if self.re_enables && self.state == Some(DriveState::SwitchOnDisabled) {
            self.re_enables = false;
            self.power.set_goal(PowerGoal::Enabled);
        }
        let Some(since) = self.enabling_since_ns else { return };
        if self.state == Some(DriveState::Fault) {
            self.trouble = Some(AxisError::Fault { error_code: self.error_code(network) });
            self.rest();
            self.power.set_goal(PowerGoal::None);
            return;
        }
        if matches!(self.guard.state(), GuardState::Running { .. }) {
            self.enabling_since_ns = None;
            return;
        }
        let waited_ms = now_ns.saturating_sub(since) / 1_000_000;
        if waited_ms > u64::from(self.settings.enable_timeout_ms) {
            self.trouble = Some(AxisError::EnableTimedOut {
                state: self.state,
                guard: self.guard.state(),
                waited_ms,
            });
            self.rest();
            self.power.set_goal(PowerGoal::Disabled);
        }
    }

    /// A drive that does not switch off, or is not heard any more, is told so for a while only.
    fn give_up_disabling(&mut self, now_ns: u64) {
        if self.power.goal() != PowerGoal::Disabled || self.is_switched_off() {
            self.disabling_since_ns = None;
            return;
        }
        let since = *self.disabling_since_ns.get_or_insert(now_ns);
        if now_ns.saturating_sub(since) > DISABLE_NS {
            self.disabling_since_ns = None;
            self.power.set_goal(PowerGoal::None);
            let not_disabled = AxisError::NotDisabled { state: self.state };
            self.trouble = self.trouble.or(Some(not_disabled));
        }
    }

    /// A node that lost the host's heartbeat has gone to Pre-operational (CiA 301, 0x1029) and
    /// stays there until it is told to start. Whoever takes the axis up or commands the drive wants
    /// that; one whose configuration is in doubt is not started.
    fn start_node(&mut self, network: &mut Network, now_ns: u64) {
        let is_wanted = self.power.is_commanding()
            || matches!(self.guard.state(), GuardState::Draining | GuardState::Reading);
        let hinders = is_wanted && !self.sight.operational && self.doubt == Reverification::None;
        if hinders && self.is_configured() && now_ns >= self.next_start_ns {
            self.next_start_ns = now_ns.saturating_add(START_PAUSE_NS);
            // A full queue is tried again after the pause.
            let _ = network.nmt(self.node, NmtCommand::Start);
        }
    }

    // Out

    /// What to send in this cycle. `stepping` makes the host's own steps, `with_target` says that
    /// this cycle carries targets. The actual position of an axis that is being enabled goes back
    /// to it in the cycle that brought it, whichever that is.
    pub(super) fn prepare(&mut self, stepping: bool, with_target: bool) -> Option<Outgoing> {
        self.decision = Decision::Closed;
        if !self.is_configured() {
            return None;
        }
        let state = self.state?;
        let command = self.power.controlword(state);
        let is_driven = self.power.goal() == PowerGoal::Enabled;
        if let Some(word) = command
            && (!is_driven || state == DriveState::QuickStopActive)
        {
            // A command that leads down: never held back by the guard, and never moving anything.
            let target = self.guard.resting_target()?;
            let rpdo = self.layout.encode(word, target);
            return Some(Outgoing { rpdo, has_target: false, ramp_step: None, commands: true });
        }
        let is_due = with_target || matches!(self.guard.state(), GuardState::Armed { .. });
        if !is_due || !(is_driven || self.resumes) {
            return None;
        }
        let (wanted, ramp_step) = self.wanted_target(stepping);
        self.decision = self.guard.decide(wanted);
        self.statistics.decided(self.decision, self.target().is_some());
        if self.decision == Decision::Wait(WaitReason::HoldsOldTarget) {
            self.enable_anew();
        }
        if matches!(self.decision, Decision::Refuse(_)) && ramp_step.is_some() {
            // The host's own motion ends at a bound, or at a motor that does not follow.
            self.ramp.stop();
        }
        let target = self.decision.target()?;
        let word = match self.decision {
            Decision::Track(_) => command?,
            _ => Controlword::of(ecan_canopen::Command::EnableOperation),
        };
        if matches!(self.decision, Decision::First(_)) {
            self.set_point.start(target);
        }
        let (bits, target) = self.mode_bits(target);
        let rpdo = self.layout.encode(word.with(bits), target);
        Some(Outgoing { rpdo, has_target: true, ramp_step, commands: command.is_some() })
    }

    /// The drive holds a target to which its actual position would be a jump. Switched off, it
    /// forgets it. An axis that takes itself up does not go so far.
    fn enable_anew(&mut self) {
        if std::mem::take(&mut self.resumes) {
            self.guard.release();
        } else {
            self.re_enables = true;
            self.power.set_goal(PowerGoal::Disabled);
        }
    }

    /// The target that is wanted, and the step of the host's own ramp that makes it.
    fn wanted_target(&self, stepping: bool) -> (Option<i32>, Option<i64>) {
        let Some(last) = self.target() else { return (None, None) };
        let halts = self.motion == Motion::Halt;
        match target_kind(self.mode) {
            TargetKind::Position if halts || stepping => {
                let goal = if halts { 0 } else { i64::from(self.settings.target_step) };
                let step = self.ramp.next(goal);
                match self.settings.range.add(last, step) {
                    Some(next) => (Some(next), Some(step)),
                    // The counter ends here.
                    None => (Some(last), Some(0)),
                }
            }
            TargetKind::Rate if halts => {
                let limit = i32::try_from(self.guard.limits().step).unwrap_or(i32::MAX);
                (Some(last - last.clamp(-limit, limit)), None)
            }
            _ => (self.wanted, None),
        }
    }

    /// Bits of the controlword that belong to the mode, and the target with them.
    fn mode_bits(&mut self, target: i32) -> (u16, i32) {
        let halts = self.motion == Motion::Halt && !self.mode.is_cyclic();
        let halt = if halts { Controlword::HALT } else { 0 };
        match self.mode {
            OperatingMode::ProfilePosition if self.is_enabled() => {
                let acknowledged = self.has_status(Statusword::MODE_12);
                let (bits, target) = self.set_point.step(target, acknowledged);
                (bits | halt, target)
            }
            OperatingMode::Homing => {
                let is_started = matches!(
                    self.procedure.map(|procedure| procedure.stage),
                    Some(Stage::Homing(_))
                );
                let start = if is_started { Controlword::MODE_4 } else { 0 };
                (start, target)
            }
            _ => (halt, target),
        }
    }

    /// The Port took the frame.
    pub(super) fn sent(&mut self, outgoing: &Outgoing, ticket: SendTicket) {
        if outgoing.commands {
            self.power.sent();
        }
        if !outgoing.has_target {
            return;
        }
        let before = self.target();
        self.guard.sent();
        if let Some(place) = self.tickets.get_mut(self.next_ticket) {
            *place = Some(ticket);
        }
        self.next_ticket = (self.next_ticket + 1) % self.tickets.len();
        match self.decision {
            Decision::First(_) => {
                self.statistics.take_ups += 1;
                self.statistics.targets_sent += 1;
                self.ramp.stop();
                if std::mem::take(&mut self.resumes) {
                    self.power.set_goal(PowerGoal::Enabled);
                }
                if matches!(self.trouble, Some(AxisError::Held(_))) {
                    self.trouble = None;
                }
            }
            Decision::Target(target) => {
                self.statistics.targets_sent += 1;
                // The host's ramp goes on from whatever motion there is.
                let made = before.map_or(0, |before| self.settings.range.distance(before, target));
                self.ramp.accept(outgoing.ramp_step.unwrap_or(made));
            }
            _ => {}
        }
    }

    /// The Port did not take the frame. Gives whether the channel's queue is full.
    pub(super) fn not_sent(&mut self, outgoing: &Outgoing, error: &SendError) -> bool {
        if outgoing.has_target {
            self.skipped();
        }
        matches!(error, SendError::Backpressure { what: Backpressure::Queue, .. })
    }

    /// Nothing can go out in this cycle: a frame was refused, of this axis or of one before it on
    /// the channel, or an image is repeated.
    pub(super) fn skipped(&mut self) {
        if self.decision.target().is_some() {
            self.decision = Decision::Wait(WaitReason::Refused);
            self.statistics.decided(self.decision, self.target().is_some());
        }
        self.guard.refused();
    }
}

/// Reasons that lie on the way to the drive, not in it.
fn is_of_the_way(reason: HoldReason) -> bool {
    !matches!(
        reason,
        HoldReason::LeftOperationEnabled(_)
            | HoldReason::NotFollowing
            | HoldReason::FollowingError
            | HoldReason::NotOperational
            | HoldReason::Commanded
    )
}
