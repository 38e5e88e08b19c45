//! Steps of the recovery of one axis.

use ecan_canopen::Network;

use super::axis::Axis;
use super::axis_state::AxisState;
use super::power::FaultReset;
use super::recovery::Recovery;
use super::setup::SetupState;
use super::status::AxisError;

/// Most attempts to enable: a hold on the path may occur again while the bus comes back.
const ENABLE_ATTEMPTS: u8 = 3;

/// Most configurations: the drive may restart while it is configured.
const CONFIGURE_ATTEMPTS: u8 = 2;

impl Axis {
    pub(crate) fn step_recovery(&mut self, network: &mut Network, now_ns: u64) {
        let Some(mut recovery) = self.recovery.take() else { return };
        if recovery.step(self, network, now_ns) {
            self.recovery = Some(recovery);
        }
    }
}

impl Recovery {
    /// Returns whether the recovery continues.
    fn step(&mut self, axis: &mut Axis, network: &mut Network, now_ns: u64) -> bool {
        match axis.setup {
            SetupState::Requested { .. } | SetupState::Configuring | SetupState::SettingMode(_) => {
                true
            }
            SetupState::Unconfigured | SetupState::Failed => {
                // A drive that does not answer and may be moving is not configured.
                let is_refused = matches!(axis.error, Some(AxisError::NotStopped { .. }));
                if self.configured >= CONFIGURE_ATTEMPTS || self.configured > 0 && is_refused {
                    return false;
                }
                self.configured += 1;
                if axis.node_share.count > 1 {
                    axis.node_share.is_setup_wanted = true;
                } else {
                    axis.request_setup(network, now_ns);
                }
                true
            }
            SetupState::Complete if axis.drive.is_in_fault() => self.reset(axis),
            SetupState::Complete => match axis.state {
                AxisState::Standby | AxisState::Stopped(_) => self.enable(axis, now_ns),
                AxisState::Active if axis.is_running() => {
                    axis.targets.is_halted = false;
                    false
                }
                _ => true,
            },
        }
    }

    fn reset(&mut self, axis: &mut Axis) -> bool {
        if matches!(axis.state, AxisState::ResettingFault(_)) {
            return true;
        }
        if self.is_reset {
            return false;
        }
        self.is_reset = true;
        axis.stop_targets();
        axis.error = None;
        axis.state = AxisState::ResettingFault(FaultReset::new(axis.cycles_per_sync));
        true
    }

    fn enable(&mut self, axis: &mut Axis, now_ns: u64) -> bool {
        let has_timed_out = matches!(axis.error, Some(AxisError::EnableTimedOut { .. }));
        if self.enabled >= ENABLE_ATTEMPTS || self.enabled > 0 && has_timed_out {
            return false;
        }
        self.enabled += 1;
        axis.begin_enable(now_ns);
        true
    }
}
