//! Steps of one axis in each cycle, and what they lead to: phase and status.

use std::time::Duration;

use ecan_canopen::{DriveState, Network};

use super::axis::Axis;
use super::drive_status::{REST_NS, is_energised};
use super::plan::AxisEvent;
use super::power::{DISABLE_NS, PowerGoal, Stop, StopCause};
use super::procedure::{ProcedureSituation, RecoverySituation, RecoveryStep};
use super::setup::{SetupSituation, SetupState, VerificationSituation};
use super::status::{AxisError, AxisPhase, AxisProgress};
use super::takeover::Situation;
use super::task::{AxisState, StateEvent};
use crate::guard::terms::GuardState;

/// Time for which a drive without an actual position must report that it is off.
const BLIND_REST_NS: u64 = 1_000_000_000;

impl Axis {
    /// Continues everything that takes several cycles. Call once per cycle, after
    /// [`observe`](Self::observe).
    pub(crate) fn step(&mut self, network: &mut Network, now_ns: u64) {
        self.restart_rest_after_offsets();
        self.step_poll(network, now_ns);
        self.restart_rest_after_offsets();
        self.step_stop(now_ns);
        self.step_setup(network, now_ns);
        self.step_state(network, now_ns);
        self.step_verification(network, now_ns);
        self.step_procedure(network, now_ns);
        self.step_recovery(network, now_ns);
        let is_used = self.task.state().needs_operational()
            || matches!(self.path.guard().state(), GuardState::Draining | GuardState::Reading);
        if is_used && self.setup.is_complete() && self.setup.is_verified() {
            self.link.start_node(&self.plan, network, now_ns);
        }
    }

    /// Restarts the detection of standstill after the end of a feed-forward: only later positions show the end
    /// of a stop.
    fn restart_rest_after_offsets(&mut self) {
        if self.plan.has_auxiliary && self.data.drops_offsets(self.link.drive().is_enabled()) {
            self.link.restart_rest();
        }
    }

    /// Continues the SDO transfers that a stop or the first contact needs.
    fn step_poll(&mut self, network: &mut Network, now_ns: u64) {
        if self.task.is_stopping() && self.setup.state().is_running() && !self.link.has_reported() {
            // A drive that never answered may be enabled; the stop needs its SDO server.
            self.setup.abandon(&self.plan, network);
        }
        let is_needed = self.link.contact().is_inspecting() || self.needs_stop_by_sdo(now_ns);
        if !is_needed || !self.link.reachability().gateway {
            self.link.cancel_poll(&self.plan, network);
            return self.step_contact(network, false, now_ns);
        }
        self.setup.suspend_verification(&self.plan, network, now_ns);
        let stop = self.task.state().stop().filter(|_| self.task.is_stopping());
        let round = self.link.next_round(&self.plan, stop, now_ns);
        if !self.setup.node_share.may_poll && !self.link.is_polling() {
            // Another axis of the node uses its SDO client.
            return self.step_contact(network, false, now_ns);
        }
        let is_answered = self.link.step_poll(&self.plan, network, now_ns, round);
        if self.link.needs_wake() {
            self.apply(AxisEvent::NoAnswer, network, now_ns);
        }
        self.step_contact(network, is_answered, now_ns);
    }

    /// Returns whether process data do not reach the drive, or their effect is not visible.
    fn needs_stop_by_sdo(&self, now_ns: u64) -> bool {
        self.task.is_stopping()
            && !self.setup.state().is_running()
            && (!self.is_commanded_by_process_data()
                || !self.setup.is_verified()
                || !self.link.reachability().operational
                || !self.link.is_fresh(now_ns))
    }

    fn step_contact(&mut self, network: &mut Network, is_answered: bool, now_ns: u64) {
        if self.link.contact().is_over() {
            return;
        }
        let situation = Situation {
            reaches_gateway: self.link.reachability().gateway,
            is_answered,
            is_stopping: self.task.is_stopping(),
            is_setup_pending: self.setup.state().is_pending(),
            now_ns,
        };
        let Self { plan, setup, link, path, .. } = self;
        let next_verification = || setup.next_verification(plan, path.mode());
        if let Some(event) = link.step_contact(plan, situation, network, next_verification) {
            self.apply(event, network, now_ns);
        }
    }

    fn step_stop(&mut self, now_ns: u64) {
        let is_fresh = self.link.is_fresh(now_ns);
        let state = self.link.drive().state;
        if let Some(stop) = self.task.note_status(is_fresh, now_ns) {
            if self.has_stopped(&stop, now_ns) {
                tracing::info!(axis = self.plan.index, "axis {}: stopped", self.plan.index);
                self.task.apply(StateEvent::Stopped, now_ns);
                if stop.enable_since_ns.is_some() && self.setup.is_complete() {
                    self.begin_enable(now_ns);
                }
                return;
            }
            if now_ns.saturating_sub(stop.since_ns) > DISABLE_NS {
                let not_disabled = AxisError::NotDisabled { state };
                self.report.error = self.report.error.or(Some(not_disabled));
            }
            let timeout = self.plan.config.enable_timeout;
            if let Some(waited) = self.task.expire_enable(timeout, now_ns) {
                let guard = self.path.guard().state();
                self.report.error = Some(AxisError::EnableTimedOut { state, guard, waited });
            }
        } else if let AxisState::Stopped(stop) = self.task.state() {
            // A command to enable may still have been on the path to the drive.
            let stays = state.is_none_or(|state| stop.is_reached(state));
            if is_fresh && !stays && self.setup.is_complete() {
                self.task.apply(StateEvent::EnabledAgain, now_ns);
            }
        }
    }

    /// Returns whether a pending stop is complete.
    fn has_stopped(&self, stop: &Stop, now_ns: u64) -> bool {
        let drive = self.link.drive();
        if self.setup.state().is_running() {
            // A drive that reported something was off before its configuration began.
            return self.link.has_reported();
        }
        let waited_ns = now_ns.saturating_sub(stop.since_ns);
        // A status from before the command confirms nothing.
        let is_confirmed = drive.heard_ns > Some(stop.commanded_ns) && self.link.is_fresh(now_ns);
        let Some(state) = drive.state.filter(|_| is_confirmed) else {
            return !self.link.has_reported() && self.link.is_absent();
        };
        let is_at_rest = self.link.is_at_rest(now_ns)
            || drive.rest.is_empty() && !is_energised(state) && waited_ns > BLIND_REST_NS;
        stop.is_reached(state) && is_at_rest && waited_ns >= REST_NS
    }

    fn step_setup(&mut self, network: &mut Network, now_ns: u64) {
        if self.setup.is_complete() {
            return;
        }
        let situation = SetupSituation {
            is_inspected: self.link.contact().is_done(),
            is_stopping: self.task.is_stopping(),
            is_gone: self.link.is_gone(),
        };
        if let Some(event) = self.setup.step(&self.plan, network, situation, now_ns) {
            self.apply(event, network, now_ns);
        }
    }

    fn step_state(&mut self, network: &mut Network, now_ns: u64) {
        let drive = self.link.drive();
        match self.task.state() {
            AxisState::Enabling { since_ns } | AxisState::ReEnabling { since_ns } => {
                let waited = Duration::from_nanos(now_ns.saturating_sub(*since_ns));
                if drive.is_in_fault() {
                    let error_code = self.plan.error_code(network);
                    self.report.error = Some(AxisError::Fault { error_code });
                    self.path.stop_targets();
                    self.task.apply(StateEvent::Fault, now_ns);
                } else if waited > self.plan.config.enable_timeout {
                    let (state, guard) = (drive.state, self.path.guard().state());
                    self.report.error = Some(AxisError::EnableTimedOut { state, guard, waited });
                    self.stop(StopCause::EnableTimedOut, now_ns);
                } else if drive.state == Some(DriveState::SwitchOnDisabled) {
                    self.task.apply(StateEvent::SwitchedOff, now_ns);
                }
                if !self.link.is_fresh(now_ns) {
                    // The drive may have restarted without a notice.
                    self.setup.require_verification();
                }
            }
            AxisState::Resuming => {
                // Enabling a drive that left Operation Enabled is the application's command.
                if !drive.is_enabled() {
                    self.path.release();
                    self.task.apply(StateEvent::LeftOperation, now_ns);
                }
            }
            AxisState::ResettingFault(reset) => {
                if reset.has_failed() {
                    let error_code = self.plan.error_code(network);
                    self.report.error = Some(AxisError::ResetFailed { error_code });
                    self.task.apply(StateEvent::ResetEnded, now_ns);
                } else if drive.state.is_some_and(|state| reset.is_complete(state)) {
                    self.task.apply(StateEvent::ResetEnded, now_ns);
                }
            }
            AxisState::Releasing(_) => {
                if self.task.step_release(&self.plan, network, now_ns) {
                    self.end_release(now_ns);
                }
            }
            AxisState::Standby
            | AxisState::Active
            | AxisState::Stopping(_)
            | AxisState::Stopped(_) => {}
        }
    }

    fn step_verification(&mut self, network: &mut Network, now_ns: u64) {
        if self.setup.is_verified() && self.setup.mode_due().is_none() {
            return;
        }
        if self.task.procedure.is_some() {
            // The procedure needs the SDO client of the node.
            return self.setup.suspend_verification(&self.plan, network, now_ns);
        }
        let situation = VerificationSituation {
            mode: self.path.mode(),
            is_running: self.path.is_running(),
            is_stopping: self.task.is_stopping(),
            is_off: self.link.drive().is_off(),
            reaches_gateway: self.link.reachability().gateway,
        };
        let event = self.setup.step_verification(&self.plan, network, situation, now_ns);
        if let Some(event) = event {
            self.apply(event, network, now_ns);
        }
    }

    fn step_procedure(&mut self, network: &mut Network, now_ns: u64) {
        let Some(mut procedure) = self.task.procedure else { return };
        let situation = ProcedureSituation {
            plan: &self.plan,
            drive: self.link.drive(),
            is_running: self.path.is_running(),
            is_at_rest: self.is_at_rest(),
            is_enabling: self.task.is_enabling(),
            is_stopping: self.task.is_stopping(),
            is_stopped: self.task.is_stopped(),
            is_silent: self.link.is_silent_in_motion(now_ns),
            error: self.report.error,
            now_ns,
        };
        let step = procedure.step(&situation, network);
        if let Some(event) = step.event {
            self.apply(event, network, now_ns);
        }
        self.task.procedure = (!step.has_ended).then_some(procedure);
        if !step.has_ended {
            return;
        }
        if procedure.error().is_some() {
            // A fault is the cause of the hold that ended the procedure.
            if !matches!(self.report.error, Some(AxisError::Fault { .. })) {
                self.report.error = procedure.error();
            }
        } else if procedure.enables_at_end() && self.setup.is_complete() {
            self.begin_enable(now_ns);
        }
    }

    fn step_recovery(&mut self, network: &mut Network, now_ns: u64) {
        let Some(mut recovery) = self.task.recovery.take() else { return };
        let state = self.task.state();
        let situation = RecoverySituation {
            setup: self.setup.state(),
            error: self.report.error,
            is_in_fault: self.link.drive().is_in_fault(),
            is_resetting: matches!(state, AxisState::ResettingFault(_)),
            may_enable: matches!(state, AxisState::Standby | AxisState::Stopped(_)),
            is_active: matches!(state, AxisState::Active) && self.path.is_running(),
        };
        let (event, continues) = match recovery.step(&situation) {
            RecoveryStep::Wait => (None, true),
            RecoveryStep::Command(event) => (Some(event), true),
            RecoveryStep::End(event) => (event, false),
        };
        if let Some(event) = event {
            self.apply(event, network, now_ns);
        }
        if continues {
            self.task.recovery = Some(recovery);
        }
    }

    // Status

    /// Returns whether the drive is known to be off, or at rest in Quick Stop Active, or never answered.
    pub(crate) fn is_stopped(&self, now_ns: u64) -> bool {
        // After a configuration that found the drive enabled, its state is read again. A drive that never answered
        // may be enabled when it answers its configuration.
        let is_awaited = !self.link.has_reported() && self.setup.state().is_pending();
        if !self.link.contact().is_done() || is_awaited {
            return false;
        }
        match self.task.state() {
            AxisState::Stopped(_) => true,
            AxisState::Standby | AxisState::Releasing(_) | AxisState::ResettingFault(_) => {
                // A command to enable may have been on the path to a drive that went silent.
                let is_silent = self.link.has_reported()
                    && self.setup.is_complete()
                    && !self.link.is_fresh(now_ns);
                let drive = self.link.drive();
                !is_silent
                    && drive.is_off_or_unknown()
                    && (drive.rest.is_empty() || drive.rest.was_at_rest())
            }
            _ => false,
        }
    }

    /// Returns the target of an axis that is running as before.
    #[inline(always)]
    pub(crate) fn update_phase(&mut self, now_ns: u64) -> Option<i32> {
        // The usual cycle, by the few comparisons with which `present_phase` returns Running.
        if let AxisPhase::Running = self.report.phase()
            && let AxisState::Active = self.task.state()
            && let SetupState::Complete = self.setup.state()
            && let None = self.task.procedure
            && let GuardState::Running { target } = self.path.guard().state()
            && !self.link.contact().is_uninspected()
            && !self.path.targets.is_halted
            && !self.link.drive().is_in_fault()
        {
            debug_assert_eq!(self.present_phase(now_ns), AxisPhase::Running);
            return Some(target);
        }
        let phase = self.present_phase(now_ns);
        self.report.set_phase(self.plan.index, phase, now_ns);
        None
    }

    fn present_phase(&self, now_ns: u64) -> AxisPhase {
        let (drive, contact) = (self.link.drive(), self.link.contact());
        let stop = self.task.state().stop().map(|stop| stop.cause);
        if let Some(cause) = stop
            && self.task.is_stopping()
            && self.link.is_silent_in_motion(now_ns)
        {
            return AxisPhase::Uncontrolled(cause);
        }
        if let Some(procedure) = &self.task.procedure {
            return if !procedure.is_homing() {
                AxisPhase::ChangingMode(procedure.mode())
            } else if procedure.has_started_homing() {
                AxisPhase::Homing(drive.homing_state())
            } else {
                AxisPhase::PreparingHoming
            };
        }
        if let Some(cause) = stop
            && self.task.is_stopping()
            && !drive.is_in_fault()
        {
            return AxisPhase::Stopping(cause);
        }
        match self.setup.state() {
            _ if contact.is_uninspected() || contact.is_adopting() => {
                return AxisPhase::Inspecting;
            }
            SetupState::Unconfigured => return AxisPhase::NotConfigured,
            SetupState::Requested { .. } | SetupState::Configuring => {
                return AxisPhase::Configuring;
            }
            SetupState::SettingMode(_) => return AxisPhase::SettingMode(self.path.mode()),
            SetupState::Failed => return AxisPhase::SetupFailed,
            SetupState::Complete => {}
        }
        match (self.task.state(), stop) {
            (AxisState::ResettingFault(_), _) => return AxisPhase::ResettingFault,
            _ if drive.is_in_fault() => return AxisPhase::Fault,
            (AxisState::ReEnabling { .. }, _) => return AxisPhase::Enabling(drive.state),
            // A drive that was switched off is ready for the next command.
            (_, Some(StopCause::Disable | StopCause::Procedure)) if drive.is_off() => {}
            (_, Some(cause)) => return AxisPhase::Stopped(cause),
            _ => {}
        }
        match self.path.guard().state() {
            GuardState::Holding { reason } => AxisPhase::Holding(reason),
            guard @ (GuardState::Draining | GuardState::Reading) => {
                AxisPhase::Reading(guard, self.path.guard().hindrance())
            }
            GuardState::Running { .. } if self.path.targets.is_halted => AxisPhase::Halted,
            GuardState::Running { .. } => AxisPhase::Running,
            GuardState::Armed { .. } if self.task.state().power_goal() == PowerGoal::Enabled => {
                AxisPhase::Enabling(drive.state)
            }
            GuardState::Armed { .. } => AxisPhase::Ready,
            GuardState::Idle => AxisPhase::Standby,
        }
    }

    pub(crate) fn progress(&self, now_ns: u64) -> AxisProgress {
        AxisProgress {
            axis: self.plan.index,
            address: self.plan.config.address,
            phase: self.report.phase(),
            elapsed: self.report.elapsed(now_ns),
            setup: self.setup.progress(&self.plan, now_ns),
            error: self.report.error,
        }
    }
}
