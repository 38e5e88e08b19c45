//! Phase and progress of an axis.

use std::time::Duration;

use ecan_canopen::{Network, OperatingMode, Statusword};

use super::axis::Axis;
use super::axis_state::AxisState;
use super::homing::HomingState;
use super::power::{PowerGoal, StopCause};
use super::procedure::Stage;
use super::setup::SetupState;
use super::status::{AxisErrorKind, AxisPhase, AxisProgress, AxisStatus};
use super::takeover::TakeoverState;
use super::units::Scale;
use crate::guard::terms::{Decision, GuardState, HoldReason};

impl Axis {
    /// Returns the target of an axis that is running as before.
    #[inline(always)]
    pub(crate) fn update_phase(&mut self, now_ns: u64) -> Option<i32> {
        // The usual cycle, by the few comparisons with which `present_phase` returns Running.
        if let AxisPhase::Running = self.phase
            && let AxisState::Active = self.state
            && let SetupState::Complete = self.setup
            && let None = self.procedure
            && let GuardState::Running { target } = self.guard.state()
            && !self.is_uninspected
            && !self.targets.is_halted
            && !self.drive.is_in_fault()
        {
            debug_assert_eq!(self.present_phase(now_ns), AxisPhase::Running);
            return Some(target);
        }
        self.change_phase(now_ns);
        None
    }

    fn change_phase(&mut self, now_ns: u64) {
        let phase = self.present_phase(now_ns);
        if phase != self.phase {
            let is_uncontrolled = |phase| matches!(phase, AxisPhase::Uncontrolled(_));
            if is_uncontrolled(phase) && !is_uncontrolled(self.phase) {
                self.statistics.uncontrolled += 1;
                tracing::warn!(axis = self.index, "axis {}: {phase}", self.index);
            }
            self.phase = phase;
            self.phase_since_ns = now_ns;
        }
    }

    fn present_phase(&self, now_ns: u64) -> AxisPhase {
        let stop = self.state.stop().map(|stop| stop.cause);
        if let Some(cause) = stop
            && self.is_uncontrolled(now_ns)
        {
            return AxisPhase::Uncontrolled(cause);
        }
        if let Some(procedure) = &self.procedure {
            return match (procedure.homing, procedure.stage) {
                (None, _) => AxisPhase::ChangingMode(procedure.mode),
                (Some(_), Stage::Homing(_)) => AxisPhase::Homing(self.homing_state()),
                (Some(_), _) => AxisPhase::PreparingHoming,
            };
        }
        if let Some(cause) = stop
            && self.state.is_stopping()
            && !self.drive.is_in_fault()
        {
            return AxisPhase::Stopping(cause);
        }
        match self.setup {
            _ if self.is_uninspected || matches!(self.takeover, TakeoverState::Adopting(_)) => {
                return AxisPhase::Inspecting;
            }
            SetupState::Unconfigured => return AxisPhase::NotConfigured,
            SetupState::Requested { .. } | SetupState::Configuring => {
                return AxisPhase::Configuring;
            }
            SetupState::SettingMode(_) => return AxisPhase::SettingMode(self.mode),
            SetupState::Failed => return AxisPhase::SetupFailed,
            SetupState::Complete => {}
        }
        match (self.state, stop) {
            (AxisState::ResettingFault(_), _) => return AxisPhase::ResettingFault,
            _ if self.drive.is_in_fault() => return AxisPhase::Fault,
            (AxisState::ReEnabling { .. }, _) => return AxisPhase::Enabling(self.drive.state),
            // A drive that was switched off is ready for the next command.
            (_, Some(StopCause::Disable | StopCause::Procedure)) if self.drive.is_off() => {}
            (_, Some(cause)) => return AxisPhase::Stopped(cause),
            _ => {}
        }
        match self.guard.state() {
            GuardState::Holding { reason } => AxisPhase::Holding(reason),
            guard @ (GuardState::Draining | GuardState::Reading) => {
                AxisPhase::Reading(guard, self.guard.hindrance())
            }
            GuardState::Running { .. } if self.targets.is_halted => AxisPhase::Halted,
            GuardState::Running { .. } => AxisPhase::Running,
            GuardState::Armed { .. } if self.state.power_goal() == PowerGoal::Enabled => {
                AxisPhase::Enabling(self.drive.state)
            }
            GuardState::Armed { .. } => AxisPhase::Ready,
            GuardState::Idle => AxisPhase::Standby,
        }
    }

    pub(crate) fn homing_state(&self) -> HomingState {
        self.drive.statusword.map_or(HomingState::Waiting, HomingState::of)
    }

    pub(crate) fn progress(&self, now_ns: u64) -> AxisProgress {
        AxisProgress {
            axis: self.index,
            address: self.config.address,
            phase: self.phase,
            elapsed: Duration::from_nanos(now_ns.saturating_sub(self.phase_since_ns)),
            setup: match self.setup {
                SetupState::Configuring => self.configurator.progress_of(self.node, now_ns),
                _ => None,
            },
            error: self.error,
        }
    }

    /// Returns whether a drive with its own trajectory has reached its target.
    pub(crate) fn is_target_reached(&self) -> bool {
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
        has_taken && self.drive.has(Statusword::TARGET_REACHED)
    }

    pub(crate) fn hold_reason(&self) -> Option<HoldReason> {
        match self.guard.state() {
            GuardState::Holding { reason } => Some(reason),
            _ => None,
        }
    }

    pub(crate) fn status(&self, network: &Network, now_ns: u64) -> AxisStatus {
        AxisStatus {
            address: self.config.address,
            phase: self.phase,
            elapsed: Duration::from_nanos(now_ns.saturating_sub(self.phase_since_ns)),
            error: self.error.map(AxisErrorKind::from),
            mode: self.mode,
            statusword: self.drive.statusword,
            error_code: self.error_code(network),
            nmt_state: network.nmt_state(self.node),
            heartbeat: network.heartbeat(self.node),
            actual: self.guard.actual(),
            actual_age: self.guard.actual_age(),
            target: self.target(),
            inputs: self.further.inputs,
            feed_forward: self.further.feed_forward.last(),
            decision: self.decision,
            hold_reason: self.hold_reason(),
            stop_cause: self.state.stop().map(|stop| stop.cause),
            is_configured: self.setup.is_complete(),
            is_running: self.follows_application(),
            is_at_rest: self.is_at_rest(),
            is_target_reached: self.is_target_reached(),
            is_stopped: self.is_stopped(now_ns),
            is_recovering: self.recovery.is_some(),
            scale: Scale::of_parts(self.config.scale.parts()),
            range: self.config.range,
        }
    }
}
