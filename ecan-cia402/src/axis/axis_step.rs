//! State machine of one axis in each cycle, apart from stops.

use std::time::Duration;

use ecan_canopen::{Configuring, DriveState, Network};

use super::axis::Axis;
use super::axis_state::AxisState;
use super::power::StopCause;
use super::status::AxisError;

impl Axis {
    /// One step of everything that continues over cycles. Call once per cycle, after
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
        self.start_node(network, now_ns);
    }

    fn step_state(&mut self, network: &mut Network, now_ns: u64) {
        match &mut self.state {
            AxisState::Enabling { since_ns } | AxisState::ReEnabling { since_ns } => {
                let since_ns = *since_ns;
                let is_off = self.drive.state == Some(DriveState::SwitchOnDisabled);
                let waited = Duration::from_nanos(now_ns.saturating_sub(since_ns));
                if self.drive.is_in_fault() {
                    let error_code = self.error_code(network);
                    self.error = Some(AxisError::Fault { error_code });
                    self.stop_targets();
                    self.state = AxisState::Standby;
                } else if waited > self.config.enable_timeout {
                    let (state, guard) = (self.drive.state, self.guard.state());
                    self.error = Some(AxisError::EnableTimedOut { state, guard, waited });
                    self.stop(StopCause::EnableTimedOut, now_ns);
                } else if is_off {
                    self.state = AxisState::Enabling { since_ns };
                }
                if !self.drive.is_fresh(now_ns, self.fresh_ns) {
                    // It may have restarted without a notice.
                    self.require_verification();
                }
            }
            AxisState::Resuming => {
                // Enabling a drive that left Operation Enabled is the application's command.
                if !self.drive.is_enabled() {
                    self.guard.release();
                    self.state = AxisState::Standby;
                }
            }
            AxisState::ResettingFault(reset) => {
                if reset.has_failed() {
                    let error_code = self.error_code(network);
                    self.error = Some(AxisError::ResetFailed { error_code });
                    self.state = AxisState::Standby;
                } else if self.drive.state.is_some_and(|state| reset.is_complete(state)) {
                    self.state = AxisState::Standby;
                }
            }
            AxisState::Releasing(script) => {
                match script.advance(network, self.node, now_ns, |_, _, _| {}) {
                    Configuring::Running => {}
                    // A drive that does not answer needs no release.
                    Configuring::Done | Configuring::Failed(_) => self.released(),
                }
            }
            AxisState::Standby
            | AxisState::Active
            | AxisState::Stopping(_)
            | AxisState::Stopped(_) => {}
        }
    }
}
