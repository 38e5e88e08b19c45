//! Phase and progress of an axis.

use std::time::Duration;

use crate::guard::terms::GuardState;

use super::axis::Axis;
use super::axis_state::AxisState;
use super::homing::HomingState;
use super::phase::{AxisPhase, AxisProgress};
use super::power::PowerGoal;
use super::procedure::Stage;
use super::setup::SetupState;
use super::stop::StopCause;
use super::takeover::TakeoverState;

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
}
