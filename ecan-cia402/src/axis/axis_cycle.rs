//! One axis in the cycle: input to the guard, and the frames to send.

use ecan_canopen::{
    Command, Controlword, DriveState, Heartbeat, Network, NodeStatus, OperatingMode, Statusword,
};
use ecan_mcan_port::{Backpressure, SendError, SendTicket, TransmitReport};

use super::axis::Axis;
use super::drive_link::has_left_operational;
use super::pdo_layout::CommandLayout;
use super::power::PowerGoal;
use super::setup::SetupState;
use super::status::AxisError;
use super::target_path::{FeedForwardStep, Outgoing, TargetTurn};
use super::task::{AxisState, StateEvent};
use crate::guard::feed_forward::FeedForward;
use crate::guard::gateway_watch::GatewayWatch;
use crate::guard::terms::{Decision, DriveView, GuardInput, WaitReason};

impl Axis {
    // Input

    pub(crate) fn begin_cycle(&mut self) {
        self.link.begin_cycle();
        self.path.begin_cycle();
    }

    /// Stores the data of a received TPDO. `nth` counts the TPDOs of the axis from 0.
    pub(crate) fn on_tpdo(&mut self, nth: usize, data: &[u8]) {
        let statistics = &mut self.report.statistics;
        if nth == 0 {
            match CommandLayout::decode(data) {
                Some(feedback) => {
                    self.link.store_feedback(feedback);
                    statistics.count_tpdo();
                }
                None => statistics.malformed_tpdos += 1,
            }
        }
        if self.plan.is_extended
            && self.setup.is_complete()
            && !self.data.store_tpdo(&self.plan, nth, data)
        {
            statistics.malformed_tpdos += u64::from(nth > 0);
        }
    }

    pub(crate) fn on_report(&mut self, report: &TransmitReport) {
        self.report.statistics.targets_lost += u64::from(self.path.on_report(report));
    }

    /// Evaluates the status of the drive and of its path in this cycle.
    pub(crate) fn observe(&mut self, watch: &GatewayWatch, network: &Network, now_ns: u64) {
        let channel = self.plan.config.address.channel;
        let drive = self.link.drive();
        let has_tpdo = drive.arrived.is_some();
        let actual = watch.actual(channel, drive.arrived.map(|feedback| feedback.position));
        self.report.statistics.count_position(actual, has_tpdo);
        let was_in_fault = drive.is_in_fault();
        let setup = self.setup.state();
        if setup.has_process_data() || matches!(setup, SetupState::SettingMode(_)) {
            self.link.update(&self.plan, now_ns);
        }
        let is_target_lost = self.path.take_lost_target();
        let status = network.status(self.plan.node);
        let input = GuardInput {
            path: watch.path(channel, is_target_lost),
            drive: self.drive_view(status.as_ref()),
            actual,
        };
        if self.plan.has_auxiliary {
            self.data.set_path_clear(input.path.is_clear());
        }
        let is_lost = self.link.update_reachability(&input);
        let may_have_restarted = if self.setup.state().is_running() {
            // The configuration itself ends Operational. A restart that the host does not see loses
            // the first steps.
            watch.lacks_image()
        } else {
            is_lost
        };
        if may_have_restarted {
            self.setup.require_verification();
        }
        if let Some(reason) = self.path.observe(&self.plan, &self.link, &input, now_ns) {
            self.on_hold(reason, now_ns);
        }
        if let Some(status) = status {
            if has_tpdo || status.nmt_state.is_some() {
                self.link.on_life_sign(self.setup.state().is_pending());
            }
            self.report.statistics.emergencies = status.emcy_count;
            if self.setup.is_complete() && self.setup.has_restarted(&status) {
                // The drive restarted, without power and without its configuration.
                self.lose_setup();
                self.task.apply(StateEvent::Restarted, now_ns);
            }
            if matches!(self.setup.state(), SetupState::Unconfigured) {
                self.setup.note_boot_ups(&status);
                self.report.statistics.restart_tpdo_count();
            }
        }
        self.update_statistics();
        if self.link.drive().is_in_fault() && !was_in_fault {
            self.on_fault(network, now_ns);
        }
    }

    fn drive_view(&self, status: Option<&NodeStatus>) -> DriveView {
        let (drive, mode) = (self.link.drive(), self.path.mode());
        let is_mode_due = self.setup.mode_due().is_some() && !self.path.is_running();
        DriveView {
            state: drive.state,
            heartbeat_lost: status.is_some_and(|node| node.heartbeat == Heartbeat::TimedOut),
            not_operational: status
                .is_some_and(|node| self.setup.has_restarted(node) || has_left_operational(node)),
            unverified: !self.setup.is_verified() || is_mode_due,
            follows: !mode.is_cyclic() || drive.has(Statusword::MODE_12),
            following_error: mode == OperatingMode::CyclicPosition
                && drive.has(Statusword::MODE_13),
        }
    }

    fn update_statistics(&mut self) {
        let (guard, statistics) = (self.path.guard(), &mut self.report.statistics);
        if self.link.drive().is_enabled() {
            let gap = guard.actual_age().min(u16::MAX - 1);
            statistics.longest_gap = statistics.longest_gap.max(gap);
        }
        if let (Some(target), Some(position)) = (self.path.target(), guard.actual())
            && self.path.follows_positions()
        {
            let error = self.plan.config.range.distance(target, position).unsigned_abs();
            statistics.max_following_error = statistics.max_following_error.max(error);
        }
    }

    // Output

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
        self.path.close();
        if self.link.contact().is_adopting() {
            let frame = self.link.contact().adoption_frame(&self.plan, repeats_commands);
            return frame.map(|(word, target)| self.command(word, target));
        }
        let is_stopping = self.task.is_stopping() && self.setup.state().has_process_data();
        if !(self.setup.is_complete() || is_stopping) {
            return None;
        }
        let (state, drive) = (self.task.state(), self.link.drive().state);
        let command = state.controlword(drive, self.link.is_at_rest(now_ns));
        let is_driven = state.power_goal() == PowerGoal::Enabled;
        if let Some(word) = command
            && (!is_driven || drive == Some(DriveState::QuickStopActive))
        {
            // The guard never delays it, and it moves nothing. Repeated in each short cycle, the commands of
            // several axes and their SYNC would occupy the bus.
            let target = self.path.guard().resting_target()?;
            let is_reset = matches!(state, AxisState::ResettingFault(_));
            let is_due = is_reset || self.path.must_send(word, repeats_commands);
            return is_due.then(|| self.command(word, target));
        }
        let may_move = is_driven || matches!(state, AxisState::Resuming);
        self.path.forget_command();
        let is_running = self.path.is_running();
        if !may_move
            || is_driven && self.link.coasts(now_ns)
            // The drive has a feed-forward although the axis gets no targets.
            || self.plan.has_auxiliary && self.data.has_offsets() && !is_running
        {
            return None;
        }
        let own_step = stepping.then_some(self.plan.config.target_step);
        let ramp = self.path.decide(turn, own_step, now_ns);
        let decision = self.path.decision();
        self.report.statistics.count_decision(decision, is_running);
        if decision == Decision::Wait(WaitReason::HoldsOldTarget) {
            // When switched off, the drive drops the target. An axis that resumes by itself is not switched off.
            if matches!(self.task.state(), AxisState::Resuming) {
                self.path.release();
            }
            self.task.apply(StateEvent::OldTarget, now_ns);
        }
        let target = decision.target()?;
        let word = match decision {
            Decision::Track(_) => command?,
            _ => Controlword::of(Command::EnableOperation),
        };
        let procedure = self.task.procedure.as_ref();
        let is_homing = procedure.is_some_and(|procedure| procedure.has_started_homing());
        let (bits, target) = self.path.mode_bits(target, self.link.drive(), is_homing);
        let rpdo = self.plan.command_layout.encode(word.with(bits), target, self.path.mode());
        Some(Outgoing { rpdo, command: None, ramp })
    }

    /// Frame with a command, and a target that moves nothing.
    fn command(&self, word: Controlword, target: i32) -> Outgoing {
        let rpdo = self.plan.command_layout.encode(word, target, self.path.mode());
        Outgoing { rpdo, command: Some(word), ramp: None }
    }

    /// Notes that the Port accepted the frame.
    pub(crate) fn on_sent(&mut self, outgoing: &Outgoing, ticket: SendTicket, now_ns: u64) {
        self.task.count_reset_frame();
        if let Some(command) = outgoing.command {
            self.path.on_command_sent(command);
            self.link.count_frame();
            return;
        }
        self.path.on_target_sent(&self.plan, outgoing, ticket);
        match self.path.decision() {
            Decision::First(_) => {
                tracing::info!(axis = self.plan.index, "axis {}: active", self.plan.index);
                self.report.statistics.activations += 1;
                self.report.statistics.targets_sent += 1;
                self.task.apply(StateEvent::FirstTarget, now_ns);
                if matches!(self.report.error, Some(AxisError::Held(_))) {
                    self.report.error = None;
                }
            }
            Decision::Target(_) => self.report.statistics.targets_sent += 1,
            _ => {}
        }
    }

    /// Notes that the Port rejected the frame. Returns whether the channel's queue is full.
    pub(crate) fn on_rejected(&mut self, outgoing: &Outgoing, error: &SendError) -> bool {
        match outgoing.command {
            None => self.skip(),
            Some(_) => self.path.forget_command(),
        }
        matches!(error, SendError::Backpressure { what: Backpressure::Queue, .. })
    }

    /// Notes that nothing can be sent in this cycle: a frame of this axis or of one before it on the channel
    /// was rejected, or an image is repeated.
    pub(crate) fn skip(&mut self) {
        let is_running = self.path.is_running();
        if self.path.skip() {
            self.report.statistics.count_decision(self.path.decision(), is_running);
        }
    }

    /// Notes the SYNC period of a cycle. `is_sent` states whether SYNC was sent on the channel of the axis,
    /// `is_gateway_ready` whether its TPDO can arrive.
    pub(crate) fn note_sync(&mut self, is_sent: bool, is_gateway_ready: bool, now_ns: u64) {
        if is_sent {
            self.path.note_sync(now_ns);
            self.link.note_sync();
        }
        let counts =
            self.setup.is_complete() && self.link.reachability().operational && is_gateway_ready;
        if !counts {
            self.report.statistics.restart_tpdo_count();
        } else if is_sent {
            self.report.statistics.count_sync();
        }
    }

    // RPDOs after the first

    /// Takes the feed-forward of the target of the first RPDO, and returns whether the
    /// other RPDOs are to be sent. `is_own_motion` states whether the host made the target.
    ///
    /// The other RPDOs go out with each target, and in the same cycles while the axis gets none, so that an
    /// output that was lost arrives. A feed-forward ends with the targets, at once.
    pub(crate) fn prepare_auxiliary(&mut self, turn: TargetTurn, is_own_motion: bool) -> bool {
        if self.data.step_offsets(&self.plan, turn) {
            self.path.restart_activation();
            self.link.restart_rest();
        }
        let before = self.data.feed_forward();
        let step = self.path.take_feed_forward(is_own_motion);
        if step == FeedForwardStep::Wait {
            return false;
        }
        let is_limited = self.data.step_feed_forward(step);
        self.report.statistics.feed_forwards_limited += u64::from(is_limited);
        self.data.update_outputs();
        let has_ended =
            before != FeedForward::NONE && self.data.feed_forward() == FeedForward::NONE;
        (turn == TargetTurn::Due || has_ended)
            && self.setup.is_complete()
            && self.data.is_path_clear()
            && self.setup.is_verified()
            && self.link.reachability().operational
    }
}
