//! Phase and progress of an axis.

use std::time::Duration;

use crate::guard::terms::GuardState;

use super::axis::Axis;
use super::axis_state::AxisState;
use super::homing::HomingState;
use super::phase::{AxisPhase, AxisProgress};
use super::power::PowerGoal;
use super::procedure::Stage;

impl Axis {
    pub(crate) fn update_phase(&mut self, now_ns: u64) {
        let phase = self.present_phase();
        if phase != self.phase {
            self.phase = phase;
            self.phase_since_ns = now_ns;
        }
    }

    fn present_phase(&self) -> AxisPhase {
        match self.state {
            AxisState::Unconfigured => return AxisPhase::NotConfigured,
            AxisState::Configuring => return AxisPhase::Configuring,
            AxisState::SettingMode(_) => return AxisPhase::SettingMode(self.mode),
            AxisState::SetupFailed => return AxisPhase::SetupFailed,
            _ => {}
        }
        if let Some(procedure) = &self.procedure {
            return match (procedure.homing, procedure.stage) {
                (None, _) => AxisPhase::ChangingMode(procedure.mode),
                (Some(_), Stage::Homing(_)) => AxisPhase::Homing(self.homing_state()),
                (Some(_), _) => AxisPhase::PreparingHoming,
            };
        }
        match self.state {
            AxisState::ResettingFault(_) => return AxisPhase::ResettingFault,
            _ if self.drive.is_in_fault() => return AxisPhase::Fault,
            AxisState::QuickStop => return AxisPhase::QuickStop,
            AxisState::ReEnabling { .. } => return AxisPhase::Enabling(self.drive.state),
            AxisState::Off | AxisState::SwitchingOff { .. } | AxisState::Releasing(_)
                if !self.drive.is_off() =>
            {
                return AxisPhase::Disabling;
            }
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
            setup: match self.state {
                AxisState::Configuring => self.configurator.progress_of(self.node, now_ns),
                _ => None,
            },
            error: self.error,
        }
    }
}
