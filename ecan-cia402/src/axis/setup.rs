//! Configuration of a drive: its steps, the values that they read, and its verification after a connection loss.

use std::sync::Arc;
use std::time::Duration;

use ecan_canopen::{
    Configurator, Configuring, MappingEntry, Network, NmtCommand, NmtState, NodeStatus,
    OperatingMode, Progress, Step, StepFailure, StepFault, TransmissionType, object,
};

use super::host_loss::{HostLoss, StopOptions};
use super::limits::DriveLimits;
use super::plan::{AxisEvent, AxisPlan};
use super::script::{Script, axis_index, axis_script, mode_steps};
use super::units::{DriveUnits, ScaleFinding, ScaleSource};
use crate::guard::terms::GuardLimits;

/// Setup of a drive, in parallel with the command that it executes.
///
/// | from | event | to |
/// | --- | --- | --- |
/// | any | configure | `Requested` |
/// | `Requested` | the drive is off, or never answered | `Configuring` |
/// | `Requested` | the drive was enabled when it answered last, and answers no more | `Failed` |
/// | `Configuring` | all steps done | `SettingMode` |
/// | `SettingMode` | the drive displays the mode | `Complete` |
/// | `Configuring`, `SettingMode` | a step failed | `Failed` |
/// | `Unconfigured` | the new owner adopts the enabled drive | `Complete` |
/// | any but `Requested` | the drive restarted, or its configuration differs | `Unconfigured` |
/// | `Complete` | the mode cannot be restored after homing | `Failed` |
/// | `Complete` | the drive no longer watches the host, after a shutdown | `Unconfigured` |
/// | `Configuring`, `SettingMode` | stop of a drive that never answered | `Unconfigured` |
#[expect(clippy::large_enum_variant, reason = "a box would allocate in the cycle")]
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) enum SetupState {
    /// Not configured, or no longer: the drive restarted.
    #[default]
    Unconfigured,
    /// The configuration begins when the drive has stopped. Until then a drive that is configured is
    /// stopped as before: a stop by SDO would overtake RPDOs that wait for their SYNC.
    Requested {
        is_configured: bool,
    },
    Configuring,
    /// The mode is written, and the drive must display it.
    SettingMode(Script),
    Failed,
    Complete,
}

impl SetupState {
    pub(crate) fn is_complete(&self) -> bool {
        matches!(self, Self::Complete)
    }

    /// Returns whether the drive has its configuration, so that process data command and report it.
    pub(crate) fn has_process_data(&self) -> bool {
        matches!(self, Self::Complete | Self::Requested { is_configured: true })
    }

    /// Returns whether the configuration is requested or runs.
    pub(crate) fn is_pending(&self) -> bool {
        matches!(self, Self::Requested { .. }) || self.is_running()
    }

    /// Returns whether configuration steps are being executed.
    pub(crate) fn is_running(&self) -> bool {
        matches!(self, Self::Configuring | Self::SettingMode(_))
    }
}

/// Pause after a verification that the drive did not answer.
const RETRY_NS: u64 = 500_000_000;

/// Verification that a drive still has its configuration: during a connection loss it may have
/// restarted unnoticed, and then its process data have another meaning.
#[expect(clippy::large_enum_variant, reason = "a box would allocate in the cycle")]
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
enum Verification {
    /// The connection was never lost, or the configuration is verified.
    #[default]
    Complete,
    /// The drive is to be asked, from this time on.
    Due {
        from_ns: u64,
    },
    Running(Script),
}

/// Part of an axis in its node, which several axes may share: the node is configured once for all of them,
/// and one of them uses its SDO client to stop.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct NodeShare {
    /// Axes of the node in the table.
    pub(crate) count: usize,
    /// The axis is the first of its node in the table: it has the steps of the configuration.
    pub(crate) is_first: bool,
    /// All axes of the node are ready for its configuration.
    pub(crate) may_begin: bool,
    /// The axis wants its node to be configured.
    pub(crate) is_setup_wanted: bool,
    /// The axis may begin SDO transfers to read the state of its drive and to stop it.
    pub(crate) may_poll: bool,
    /// An axis of the node has a fresh status.
    pub(crate) is_heard: bool,
}

impl Default for NodeShare {
    /// The only axis of its node.
    fn default() -> Self {
        Self {
            count: 1,
            is_first: true,
            may_begin: true,
            is_setup_wanted: false,
            may_poll: true,
            is_heard: false,
        }
    }
}

/// Values that the configuration read from a drive. Those of an earlier configuration end when the drive
/// restarts.
#[derive(Debug, Clone, Copy, Default)]
pub struct DriveValues {
    /// Producer heartbeat time.
    heartbeat_ms: Option<u64>,
    /// Stop behaviour; `None` before the end of the configuration.
    pub stop_options: Option<StopOptions>,
    /// Limits, if [`DriveConfig::use_limits`](crate::DriveConfig::use_limits) asks for them. The limits in force
    /// are those of the [guard](crate::AxisRef::guard).
    pub limits: Option<DriveLimits>,
    /// Units, if [`AxisConfig::scale_source`](crate::AxisConfig::scale_source) asks for them.
    pub units: Option<DriveUnits>,
    /// Difference between the scale of the axis and the units, see
    /// [`AxisConfig::scale_source`](crate::AxisConfig::scale_source); also logged as a warning at the end of the
    /// configuration.
    pub scale_finding: Option<ScaleFinding>,
}

/// Situation of an axis in a cycle, for its setup.
#[derive(Debug, Clone, Copy)]
pub(crate) struct SetupSituation {
    /// The first contact with the drive is complete.
    pub(crate) is_inspected: bool,
    pub(crate) is_stopping: bool,
    /// The drive cannot be reached.
    pub(crate) is_gone: bool,
}

/// Situation of an axis in a cycle, for the verification of its configuration.
#[derive(Debug, Clone, Copy)]
pub(crate) struct VerificationSituation {
    pub(crate) mode: OperatingMode,
    pub(crate) is_running: bool,
    pub(crate) is_stopping: bool,
    pub(crate) is_off: bool,
    pub(crate) reaches_gateway: bool,
}

/// Configuration of the drive of an axis.
#[derive(Debug)]
pub(crate) struct AxisSetup {
    state: SetupState,
    /// Holds the steps of the configuration of the node, if the axis is the first of it.
    configurator: Configurator,
    pub(crate) node_share: NodeShare,
    values: DriveValues,
    /// SDO requests without an answer when the configuration began.
    silences: u64,
    /// Boot-up messages when the configuration was complete.
    boot_ups: u32,
    verification: Verification,
    /// PDOs that the verification reads, from 0 on.
    verified_pdos: usize,
    /// A procedure was cancelled after it had begun to write a mode: this one is written before the
    /// drive is enabled.
    mode_due: Option<OperatingMode>,
}

impl AxisSetup {
    pub(crate) fn new() -> Self {
        Self {
            state: SetupState::default(),
            configurator: Configurator::new(),
            node_share: NodeShare::default(),
            values: DriveValues::default(),
            silences: 0,
            boot_ups: 0,
            verification: Verification::default(),
            verified_pdos: 0,
            mode_due: None,
        }
    }

    pub(crate) fn state(&self) -> &SetupState {
        &self.state
    }

    pub(crate) fn is_complete(&self) -> bool {
        self.state.is_complete()
    }

    pub(crate) fn values(&self) -> &DriveValues {
        &self.values
    }

    /// Mode that is written before the drive is enabled.
    pub(crate) fn mode_due(&self) -> Option<OperatingMode> {
        self.mode_due
    }

    /// Mode in which the axis follows targets, by its present mode.
    pub(crate) fn intended_mode(&self, mode: OperatingMode) -> OperatingMode {
        self.mode_due.unwrap_or(mode)
    }

    pub(crate) fn set_mode_due(&mut self, mode: Option<OperatingMode>) {
        self.mode_due = mode;
    }

    /// Limits of the motion guard in a mode: those of the configuration, narrowed by those of the drive.
    pub(crate) fn guard_limits(
        &self,
        plan: &AxisPlan,
        mode: OperatingMode,
        period_ns: u64,
    ) -> GuardLimits {
        let mut limits = plan.config.guard_limits(mode, plan.cycles_per_sync);
        if let Some((drive, units)) = self.values.limits.zip(self.values.units) {
            drive.narrow(&mut limits, (mode, &plan.config), &units, period_ns);
        }
        limits.drain_images = limits.drain_images.saturating_add(plan.schedule_images);
        limits
    }

    /// Reaction of the drive to the loss of the host.
    pub(crate) fn host_loss(
        &self,
        plan: &AxisPlan,
        mode: OperatingMode,
        network: &Network,
    ) -> HostLoss {
        let host = network.host_heartbeat().map(|heartbeat| heartbeat.node);
        let address = (plan.index, plan.config.address);
        HostLoss::new(address, mode, self.values.stop_options.as_ref(), host)
    }

    // Configuration

    /// Prepares the steps of the configuration of the axes of its node, so that executing them does not
    /// allocate. Only for the first of them.
    pub(crate) fn load_steps(&mut self, plan: &AxisPlan, network: &mut Network, steps: Vec<Step>) {
        network.set_parameters(plan.node, Arc::clone(&plan.config.drive.parameters));
        self.configurator.clear(network);
        self.configurator.add(network, plan.node, steps);
    }

    /// Requests the configuration.
    pub(crate) fn request(&mut self, plan: &AxisPlan, network: &mut Network) {
        self.cancel(plan, network);
        let is_configured = self.state.has_process_data() && self.is_verified();
        self.state = SetupState::Requested { is_configured };
        self.verification = Verification::Complete;
        self.values.stop_options = None;
    }

    fn cancel(&mut self, plan: &AxisPlan, network: &mut Network) {
        if self.state.is_running() {
            self.configurator.restart(network);
            if let SetupState::SettingMode(script) = self.state {
                script.cancel(network, plan.node);
            }
        }
    }

    /// Ends a configuration that runs: the drive is to be stopped first.
    pub(crate) fn abandon(&mut self, plan: &AxisPlan, network: &mut Network) {
        self.cancel(plan, network);
        self.state = SetupState::Unconfigured;
    }

    /// Begins the steps.
    pub(crate) fn begin(&mut self, plan: &AxisPlan, network: &mut Network) {
        let status = network.status(plan.node);
        let is_stopped = Some(NmtState::Stopped);
        if status.is_some_and(|node| {
            node.nmt_state == is_stopped || node.expected_nmt_state == is_stopped
        }) {
            // The first steps read the state of the drive, and in Stopped it has no SDO server. If the queue is
            // full, the configuration fails, and the next one begins with an inspection.
            let _ = network.nmt(plan.node, NmtCommand::EnterPreOperational);
        }
        self.configurator.restart(network);
        self.silences = network.sdo_silences(plan.node);
        self.state = SetupState::Configuring;
    }

    /// Continues the configuration.
    pub(crate) fn step(
        &mut self,
        plan: &AxisPlan,
        network: &mut Network,
        situation: SetupSituation,
        now_ns: u64,
    ) -> Option<AxisEvent> {
        let (configuring, done) = match &mut self.state {
            SetupState::Requested { .. } if situation.is_inspected => {
                if !situation.is_stopping {
                    return self.node_share.may_begin.then_some(AxisEvent::SetupReady);
                }
                if situation.is_gone {
                    self.state = SetupState::Failed;
                    return Some(AxisEvent::NotStopped);
                }
                return None;
            }
            // The first axis of the node configures all of them.
            SetupState::Configuring if self.node_share.is_first => {
                (self.configurator.step(network, now_ns), AxisEvent::StepsDone)
            }
            SetupState::SettingMode(script) => {
                let configuring = script.advance(network, plan.node, now_ns, |_, _, _| {});
                (configuring, AxisEvent::SetupDone)
            }
            _ => return None,
        };
        match configuring {
            Configuring::Running => None,
            Configuring::Done => Some(done),
            Configuring::Failed(failure) => Some(AxisEvent::SetupFailed(failure)),
        }
    }

    /// Progress of the steps, while they run.
    pub(crate) fn progress(&self, plan: &AxisPlan, now_ns: u64) -> Option<Progress> {
        match self.state {
            SetupState::Configuring => self.configurator.progress_of(plan.node, now_ns),
            _ => None,
        }
    }

    /// Moves the configurator out; [`return_configurator`](Self::return_configurator) stores it again.
    pub(crate) fn take_configurator(&mut self) -> Configurator {
        std::mem::take(&mut self.configurator)
    }

    pub(crate) fn return_configurator(&mut self, configurator: Configurator) {
        self.configurator = configurator;
    }

    /// Stores the values that the steps of the node read. Returns whether limits and units of the drive are
    /// among them.
    pub(crate) fn read_back(
        &mut self,
        plan: &mut AxisPlan,
        mode: OperatingMode,
        network: &Network,
        configurator: &Configurator,
    ) -> bool {
        let (node, axis) = (plan.node, plan.config.node_axis);
        let value =
            |index, subindex| configurator.uploaded(node, axis_index(axis, index), subindex);
        self.values.heartbeat_ms = configurator.uploaded(node, object::PRODUCER_HEARTBEAT, 0);
        self.values.stop_options = Some(StopOptions::from_values(value));
        let loss = self.host_loss(plan, mode, network);
        if !loss.reaction.is_controlled_stop() {
            tracing::warn!(axis = plan.index, "{loss}");
        }
        self.read_back_limits(plan, value)
    }

    fn read_back_limits(
        &mut self,
        plan: &mut AxisPlan,
        value: impl Fn(u16, u8) -> Option<u64> + Copy,
    ) -> bool {
        let reads_limits = plan.config.reads_limits();
        let source = plan.config.scale_source;
        if source == ScaleSource::Configured && !reads_limits {
            return false;
        }
        let units = DriveUnits::from_values(value);
        self.values.limits = reads_limits.then(|| DriveLimits::from_values(value));
        self.values.units = Some(units);
        if source == ScaleSource::Drive
            && let Some(scale) = units.scale(plan.config.scale.parts().1)
        {
            plan.config.scale = scale;
        }
        if source != ScaleSource::Configured
            && let Some(finding) = ScaleFinding::of(plan.config.scale, &units)
        {
            tracing::warn!(axis = plan.index, "axis {}: {finding}", plan.index);
            self.values.scale_finding = Some(finding);
        }
        true
    }

    /// Begins to write the mode, the last step of the configuration.
    pub(crate) fn begin_mode(&mut self, plan: &AxisPlan, mode: OperatingMode) {
        self.state = SetupState::SettingMode(mode_script(plan, mode));
    }

    /// Ends the configuration: the drive displays the mode.
    pub(crate) fn finish(&mut self, plan: &AxisPlan, network: &mut Network) {
        // The value that was written and read back; none if the drive has no heartbeat.
        self.complete(plan, network, self.values.heartbeat_ms.unwrap_or_default());
        if network.sdo_silences(plan.node) != self.silences {
            // The drive may have restarted in between, and lost the first steps.
            self.require_verification();
        }
    }

    /// Notes that the drive has the configuration of the axis and remains enabled.
    pub(crate) fn adopt(&mut self, plan: &AxisPlan, network: &mut Network) {
        self.verification = Verification::Complete;
        self.values.heartbeat_ms = None;
        self.complete(plan, network, plan.config.drive.heartbeat_ms.into());
    }

    fn complete(&mut self, plan: &AxisPlan, network: &mut Network, heartbeat_ms: u64) {
        self.state = SetupState::Complete;
        self.mode_due = None;
        if let Some(guarding) = plan.config.drive.guarding {
            // infallible: the table was checked
            let _ = network.set_guarding(plan.node, Some(guarding));
        } else {
            let timeout = Duration::from_millis(heartbeat_ms.saturating_mul(7) / 2);
            network.set_heartbeat_timeout(plan.node, timeout);
        }
        self.boot_ups = network.status(plan.node).map_or(0, |status| status.boot_ups);
    }

    pub(crate) fn fail(&mut self) {
        self.state = SetupState::Failed;
    }

    /// Notes that the drive lost its configuration: its process data have another meaning.
    pub(crate) fn lose(&mut self) {
        self.state = SetupState::Unconfigured;
        self.verification = Verification::Complete;
        self.values.stop_options = None;
    }

    /// Notes that the drive must be configured before it is enabled again.
    pub(crate) fn end(&mut self) {
        self.state = SetupState::Unconfigured;
    }

    /// Forgets the limits and units of the drive.
    pub(crate) fn forget_drive(&mut self) {
        self.values.limits = None;
        self.values.units = None;
        self.values.scale_finding = None;
    }

    /// Notes that the drive no longer watches the host, by the means that are set.
    pub(crate) fn release_watches(&mut self, has_heartbeat: bool, has_guarding: bool) {
        if let Some(options) = &mut self.values.stop_options {
            let [released, _] = &mut options.watches;
            *released = released.filter(|_| !has_heartbeat);
            options.guarding = options.guarding.filter(|_| !has_guarding);
        }
    }

    // Restarts of the drive

    /// Returns whether the node restarted since its configuration.
    pub(crate) fn has_restarted(&self, status: &NodeStatus) -> bool {
        status.boot_ups != self.boot_ups
    }

    /// Stores the number of boot-up messages of a node that is not configured.
    pub(crate) fn note_boot_ups(&mut self, status: &NodeStatus) {
        self.boot_ups = status.boot_ups;
    }

    // Verification

    pub(crate) fn is_verified(&self) -> bool {
        matches!(self.verification, Verification::Complete)
    }

    /// Requests a verification: the drive may have restarted unnoticed.
    pub(crate) fn require_verification(&mut self) {
        match &mut self.state {
            // The configuration that follows verifies it.
            SetupState::Requested { is_configured } => *is_configured = false,
            SetupState::Unconfigured | SetupState::Failed => {}
            SetupState::Complete | SetupState::Configuring | SetupState::SettingMode(_) => {
                if matches!(self.verification, Verification::Complete) {
                    self.verification = Verification::Due { from_ns: 0 };
                }
            }
        }
    }

    pub(crate) fn suspend_verification(
        &mut self,
        plan: &AxisPlan,
        network: &mut Network,
        now_ns: u64,
    ) {
        if let Verification::Running(script) = self.verification {
            script.cancel(network, plan.node);
            self.verification = Verification::Due { from_ns: now_ns };
        }
    }

    /// Continues a verification. A drive that does not answer is asked again.
    pub(crate) fn step_verification(
        &mut self,
        plan: &AxisPlan,
        network: &mut Network,
        situation: VerificationSituation,
        now_ns: u64,
    ) -> Option<AxisEvent> {
        let VerificationSituation { mode, is_running, is_stopping, is_off, reaches_gateway } =
            situation;
        if !self.is_complete() || is_stopping {
            return None;
        }
        if self.mode_due.is_some() && !is_running {
            self.require_verification();
        }
        match &mut self.verification {
            Verification::Complete => {}
            Verification::Due { from_ns } => {
                // The mode is only changed while the drive is off.
                let may_begin = self.mode_due.is_none() || is_off;
                if reaches_gateway && now_ns >= *from_ns && may_begin {
                    self.begin_verification(plan, mode);
                }
            }
            Verification::Running(script) => {
                match script.advance(network, plan.node, now_ns, |_, _, _| {}) {
                    Configuring::Running => {}
                    Configuring::Done => {
                        if let Some(mode) = self.mode_due {
                            return Some(AxisEvent::ModeRestored(mode));
                        }
                        self.verification = match self.next_verification(plan, mode) {
                            Some(script) => Verification::Running(script),
                            None => Verification::Complete,
                        };
                    }
                    Configuring::Failed(StepFailure {
                        fault: StepFault::Mismatch { .. }, ..
                    }) => return Some(AxisEvent::ConfigurationDiffers),
                    Configuring::Failed(_) => {
                        let from_ns = now_ns.saturating_add(RETRY_NS);
                        self.verification = Verification::Due { from_ns };
                        return Some(AxisEvent::NoAnswer);
                    }
                }
            }
        }
        None
    }

    /// Begins to write a mode that is due, or else to read the configuration.
    pub(crate) fn begin_verification(&mut self, plan: &AxisPlan, mode: OperatingMode) {
        let script = match self.mode_due {
            Some(mode) => {
                self.verified_pdos = 0;
                mode_script(plan, mode)
            }
            None => self.first_verification(plan, mode),
        };
        self.verification = Verification::Running(script);
    }

    /// Returns the script that reads the first PDOs.
    pub(crate) fn first_verification(&mut self, plan: &AxisPlan, mode: OperatingMode) -> Script {
        self.verified_pdos = 0;
        self.verification_script(plan, mode)
    }

    /// Returns the script of the next PDOs after one that is complete.
    pub(crate) fn next_verification(
        &mut self,
        plan: &AxisPlan,
        mode: OperatingMode,
    ) -> Option<Script> {
        self.verified_pdos += 1;
        let count = plan.layout.rpdo_count().max(plan.layout.tpdo_count());
        (self.verified_pdos < count).then(|| self.verification_script(plan, mode))
    }

    /// Reads what a restart would have changed: the mapping of an RPDO and a TPDO, with those of the
    /// first stage heartbeat or guard time, and mode.
    fn verification_script(&self, plan: &AxisPlan, mode: OperatingMode) -> Script {
        let (axis, stage) = (plan.config.node_axis, self.verified_pdos);
        let nth = plan.config.pdos.number.saturating_sub(1) + stage as u16;
        let has_rpdo = stage < plan.layout.rpdo_count();
        let has_tpdo = stage < plan.layout.tpdo_count();
        let rpdo = has_rpdo.then(|| {
            let index = object::RPDO_MAPPING + nth;
            mapping_steps(index, || plan.layout.rpdo_entries(stage))
        });
        let tpdo = has_tpdo.then(|| {
            let index = object::TPDO_MAPPING + nth;
            mapping_steps(index, || plan.layout.tpdo_entries(stage))
        });
        let mapping = rpdo.into_iter().flatten().chain(tpdo.into_iter().flatten());
        let communication = [
            has_rpdo.then_some(object::RPDO_COMMUNICATION),
            has_tpdo.then_some(object::TPDO_COMMUNICATION),
        ];
        let synchronous = TransmissionType::Synchronous(1).raw();
        let transmission = communication
            .into_iter()
            .flatten()
            .map(|communication| Step::expect(communication + nth, 2, synchronous));
        if stage > 0 {
            return axis_script(axis, mapping.chain(transmission));
        }
        let life = match &plan.config.drive.guarding {
            Some(guarding) => {
                let time_ms = guarding.guard_time.as_millis() as u64;
                Some(Step::expect(object::GUARD_TIME, 0, time_ms))
            }
            None => {
                let producer = object::PRODUCER_HEARTBEAT;
                self.values.heartbeat_ms.map(|period_ms| Step::expect(producer, 0, period_ms))
            }
        };
        let mode = Step::expect(object::MODE_DISPLAY, 0, mode.raw());
        axis_script(axis, mapping.chain(transmission).chain(life).chain([mode]))
    }
}

/// Steps that compare a PDO mapping with its entries.
fn mapping_steps<I: Iterator<Item = MappingEntry>>(
    index: u16,
    entries: impl Fn() -> I,
) -> impl Iterator<Item = Step> {
    let count = Step::expect(index, 0, entries().count() as u32);
    let entries = (1..).zip(entries());
    let entries = entries.map(move |(nth, entry)| Step::expect(index, nth, entry.raw()));
    [count].into_iter().chain(entries)
}

/// Writes a mode and waits until the drive displays it.
fn mode_script(plan: &AxisPlan, mode: OperatingMode) -> Script {
    axis_script(plan.config.node_axis, mode_steps(mode))
}
