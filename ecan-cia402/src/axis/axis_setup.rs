//! Setup of one axis: configuration, adoption, loss of the configuration.

use std::sync::Arc;
use std::time::Duration;

use ecan_canopen::{Configuring, Network, PdoMappingError, StepFailure, StepFault, object};

use super::axis::Axis;
use super::axis_state::AxisState;
use super::drive_limits::DriveLimits;
use super::drive_units::{DriveUnits, ScaleFinding, ScaleSource};
use super::host_loss::StopOptions;
use super::input_object::AxisInputs;
use super::phase::AxisError;
use super::script::{mode_steps, script};
use super::setup::SetupState;
use super::setup_steps::{self, BusConfig};
use super::stop::StopCause;
use super::takeover::TakeoverState;
use super::verification::Verification;

impl Axis {
    /// Prepares the steps of the configuration, so that executing them does not allocate.
    pub(crate) fn load_steps(
        &mut self,
        network: &mut Network,
        bus: &BusConfig,
    ) -> Result<(), PdoMappingError> {
        let steps = setup_steps::steps(&self.config, bus)?;
        network.set_parameters(self.node, Arc::clone(&self.config.drive.parameters));
        self.configurator.clear(network);
        self.configurator.add(network, self.node, steps);
        Ok(())
    }

    /// Requests the configuration. It begins when the drive is off.
    pub(crate) fn configure(&mut self, network: &mut Network, now_ns: u64) {
        self.stop_targets();
        self.cancel_procedure(network);
        self.cancel_setup(network);
        self.verification = Verification::Complete;
        self.stop_options = None;
        self.recovery = None;
        self.error = None;
        self.setup = SetupState::Requested;
        let is_known = self.drive.state.is_some() && self.drive.is_fresh(now_ns, self.fresh_ns);
        let is_enabling = self.state.enabling_since_ns().is_some();
        if !self.drive.is_off_or_unknown() || is_enabling {
            self.stop(StopCause::Configure, now_ns);
        } else if !is_known && !self.state.is_stopping() && self.takeover == TakeoverState::Done {
            self.takeover = TakeoverState::Waiting;
        }
    }

    pub(crate) fn cancel_setup(&mut self, network: &mut Network) {
        if self.setup.is_running() {
            self.configurator.restart(network);
            if let SetupState::SettingMode(script) = self.setup {
                script.cancel(network, self.node);
            }
        }
    }

    pub(crate) fn step_setup(&mut self, network: &mut Network, now_ns: u64) {
        match &mut self.setup {
            SetupState::Requested if self.takeover == TakeoverState::Done => {
                if !self.state.is_stopping() {
                    self.begin_setup(network);
                } else if self.is_gone() {
                    self.setup = SetupState::Failed;
                    self.error = Some(AxisError::NotStopped { state: self.drive.state });
                }
            }
            SetupState::Configuring => match self.configurator.step(network, now_ns) {
                Configuring::Running => {}
                Configuring::Done => {
                    self.setup = SetupState::SettingMode(script(mode_steps(self.mode)));
                }
                Configuring::Failed(failure) => self.setup_failed(failure),
            },
            SetupState::SettingMode(script) => {
                match script.advance(network, self.node, now_ns, |_, _, _| {}) {
                    Configuring::Running => {}
                    Configuring::Done => self.finish_setup(network),
                    Configuring::Failed(failure) => self.setup_failed(failure),
                }
            }
            _ => {}
        }
    }

    fn begin_setup(&mut self, network: &mut Network) {
        self.poll.cancel(network, self.node);
        self.configurator.restart(network);
        self.set_mode(self.config.mode);
        self.silences = network.sdo_silences(self.node);
        self.forget_drive();
        self.state = AxisState::Standby;
        self.setup = SetupState::Configuring;
    }

    pub(crate) fn setup_failed(&mut self, failure: StepFailure) {
        tracing::error!(axis = self.index, "axis {}: configuration failed ({failure})", self.index);
        self.setup = SetupState::Failed;
        self.error = Some(AxisError::Setup(failure));
        if matches!(failure.fault, StepFault::Mismatch { .. }) {
            // It may be the statusword: a drive that was silent at the first contact is enabled.
            self.takeover = TakeoverState::Waiting;
        }
    }

    fn finish_setup(&mut self, network: &mut Network) {
        let producer = object::PRODUCER_HEARTBEAT;
        // The value that was written and read back; none if the drive has no heartbeat.
        let period_ms = self.configurator.uploaded(self.node, producer, 0).unwrap_or_default();
        self.complete_setup(network, period_ms);
        self.read_back_stop_options(network);
        self.read_back_limits();
        if network.sdo_silences(self.node) != self.silences {
            // The drive may have restarted in between, and lost the first steps.
            self.require_verification();
        }
    }

    /// The drive has the configuration of the axis and remains enabled.
    pub(crate) fn adopt(&mut self, network: &mut Network) {
        tracing::info!(axis = self.index, "axis {}: enabled drive adopted", self.index);
        self.set_mode(self.config.mode);
        self.verification = Verification::Complete;
        self.state = AxisState::Standby;
        // Of an earlier owner.
        self.further.offsets_in_force = self.has_auxiliary;
        self.complete_setup(network, self.config.drive.heartbeat_ms.into());
    }

    fn complete_setup(&mut self, network: &mut Network, heartbeat_ms: u64) {
        self.setup = SetupState::Complete;
        if let Some(guarding) = self.config.drive.guarding {
            // infallible: the table was checked
            let _ = network.set_guarding(self.node, Some(guarding));
        } else {
            let timeout = Duration::from_millis(heartbeat_ms.saturating_mul(7) / 2);
            network.set_heartbeat_timeout(self.node, timeout);
        }
        self.boot_ups = network.status(self.node).map_or(0, |status| status.boot_ups);
        self.statistics.restart_tpdo_count();
    }

    /// Takes the limits and units of the drive, if they were read.
    fn read_back_limits(&mut self) {
        let value = |index, subindex| self.configurator.uploaded(self.node, index, subindex);
        let reads_limits = self.config.reads_limits();
        let source = self.config.scale_source;
        if source == ScaleSource::Configured && !reads_limits {
            return;
        }
        let units = DriveUnits::from_values(value);
        self.further.limits = reads_limits.then(|| DriveLimits::from_values(value));
        self.further.units = Some(units);
        if source == ScaleSource::Drive
            && let Some(scale) = units.scale(self.config.scale.parts().1)
        {
            self.config.scale = scale;
        }
        if source != ScaleSource::Configured
            && let Some(finding) = ScaleFinding::of(self.config.scale, &units)
        {
            tracing::warn!(axis = self.index, "axis {}: {finding}", self.index);
            self.further.scale_finding = Some(finding);
        }
        self.set_mode(self.mode);
    }

    fn read_back_stop_options(&mut self, network: &Network) {
        let value = |index, subindex| self.configurator.uploaded(self.node, index, subindex);
        self.stop_options = Some(StopOptions::from_values(value));
        let loss = self.host_loss(network);
        if !loss.reaction.is_controlled_stop() {
            tracing::warn!(axis = self.index, "{loss}");
        }
    }

    /// The drive restarted, without power and without its configuration.
    pub(crate) fn restarted(&mut self) {
        self.lose_setup();
        if !self.state.is_stopping() {
            self.state = AxisState::Standby;
        }
    }

    /// The drive has another configuration, and may be enabled: its state is read by SDO, and it is
    /// stopped if necessary.
    pub(crate) fn configuration_differs(&mut self) {
        self.lose_setup();
        self.takeover = TakeoverState::Waiting;
    }

    /// The process data of the drive have another meaning.
    fn lose_setup(&mut self) {
        tracing::warn!(axis = self.index, "axis {}: configuration lost", self.index);
        self.stop_targets();
        self.setup = SetupState::Unconfigured;
        self.verification = Verification::Complete;
        self.error = Some(AxisError::Restarted);
        self.procedure = None;
        self.stop_options = None;
        self.forget_drive();
    }

    fn forget_drive(&mut self) {
        self.drive.forget();
        self.further.inputs = AxisInputs::default();
        self.further.limits = None;
        self.further.units = None;
        self.further.scale_finding = None;
        self.further.feed_forward.end();
        self.further.offsets_in_force = false;
        self.further.cleared_cycles = 0;
    }
}
