//! Setup of one axis: configuration, adoption, loss of the configuration.

use std::sync::Arc;
use std::time::Duration;

use ecan_canopen::{
    Configurator, Configuring, Network, NmtCommand, NmtState, Step, StepFailure, StepFault, object,
};

use super::axis::Axis;
use super::axis_state::AxisState;
use super::host_loss::StopOptions;
use super::limits::DriveLimits;
use super::pdo_layout::AxisInputs;
use super::power::StopCause;
use super::script::axis_index;
use super::setup::{SetupState, Verification};
use super::status::AxisError;
use super::takeover::TakeoverState;
use super::units::{DriveUnits, ScaleFinding, ScaleSource};

impl Axis {
    /// Prepares the steps of the configuration of the axes of its node, so that executing them does not
    /// allocate. Only for the first of them.
    pub(crate) fn load_steps(&mut self, network: &mut Network, steps: Vec<Step>) {
        network.set_parameters(self.node, Arc::clone(&self.config.drive.parameters));
        self.configurator.clear(network);
        self.configurator.add(network, self.node, steps);
    }

    /// Requests the configuration. It begins when all axes of the node are off.
    pub(crate) fn configure(&mut self, network: &mut Network, now_ns: u64) {
        self.recovery = None;
        self.request_setup(network, now_ns);
    }

    /// As [`configure`](Self::configure), without an end of the recovery.
    pub(crate) fn request_setup(&mut self, network: &mut Network, now_ns: u64) {
        self.stop_targets();
        self.cancel_procedure(network);
        self.cancel_setup(network);
        let is_configured = self.setup.has_process_data() && self.is_verified();
        self.setup = SetupState::Requested { is_configured };
        self.verification = Verification::Complete;
        self.stop_options = None;
        self.error = None;
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
            SetupState::Requested { .. } if self.takeover == TakeoverState::Done => {
                if !self.state.is_stopping() {
                    if self.node_share.may_begin {
                        self.begin_setup(network);
                    }
                } else if self.is_gone() {
                    self.setup = SetupState::Failed;
                    self.error = Some(AxisError::NotStopped { state: self.drive.state });
                }
            }
            // The first axis of the node configures all of them.
            SetupState::Configuring if !self.node_share.is_first => {}
            SetupState::Configuring => match self.configurator.step(network, now_ns) {
                Configuring::Running => {}
                Configuring::Done => {
                    let configurator = std::mem::take(&mut self.configurator);
                    self.steps_done(network, &configurator);
                    self.configurator = configurator;
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

    /// The steps of the node are complete: takes the values that they read, and sets the mode.
    pub(crate) fn steps_done(&mut self, network: &Network, configurator: &Configurator) {
        let (node, axis) = (self.node, self.config.node_axis);
        let value =
            |index, subindex| configurator.uploaded(node, axis_index(axis, index), subindex);
        self.heartbeat_ms = configurator.uploaded(node, object::PRODUCER_HEARTBEAT, 0);
        self.read_back_stop_options(network, value);
        self.read_back_limits(value);
        self.setup = SetupState::SettingMode(self.mode_script(self.mode));
    }

    /// Returns whether the axis is ready for the configuration of its node.
    pub(crate) fn is_ready_for_setup(&self) -> bool {
        matches!(self.setup, SetupState::Requested { .. })
            && self.takeover == TakeoverState::Done
            && !self.state.is_stopping()
    }

    pub(crate) fn begin_setup(&mut self, network: &mut Network) {
        self.poll.cancel(network, self.node);
        let status = network.status(self.node);
        let is_stopped = Some(NmtState::Stopped);
        if status.is_some_and(|node| {
            node.nmt_state == is_stopped || node.expected_nmt_state == is_stopped
        }) {
            // The first steps read the state of the drive, and in Stopped it has no SDO server. If the queue is
            // full, the configuration fails, and the next one begins with an inspection.
            let _ = network.nmt(self.node, NmtCommand::EnterPreOperational);
        }
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
        // The value that was written and read back; none if the drive has no heartbeat.
        self.complete_setup(network, self.heartbeat_ms.unwrap_or_default());
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
        let heartbeat_ms = self.config.drive.heartbeat_ms.into();
        self.heartbeat_ms = None;
        self.complete_setup(network, heartbeat_ms);
    }

    fn complete_setup(&mut self, network: &mut Network, heartbeat_ms: u64) {
        self.setup = SetupState::Complete;
        self.mode_due = None;
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
    fn read_back_limits(&mut self, value: impl Fn(u16, u8) -> Option<u64> + Copy) {
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

    fn read_back_stop_options(
        &mut self,
        network: &Network,
        value: impl Fn(u16, u8) -> Option<u64>,
    ) {
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
