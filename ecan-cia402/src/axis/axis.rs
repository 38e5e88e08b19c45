//! One axis: its parts, the commands of the application, and the events of the parts.

use std::time::Duration;

use ecan_canopen::{
    Configurator, DriveState, Network, OperatingMode, Step, StepFailure, StepFault, object,
};

use super::drive_link::DriveLink;
use super::error::CommandError;
use super::host_loss::HostLoss;
use super::plan::{AxisEvent, AxisPlan};
use super::power::{FaultReset, StopCause};
use super::procedure::{HomingConfig, Procedure};
use super::process_data::{Output, ProcessData};
use super::ramp::RampLimits;
use super::script::axis_script;
use super::setup::{AxisSetup, SetupState};
use super::setup_steps;
use super::status::{AxisError, AxisReport};
use super::target_path::TargetPath;
use super::targets::TargetPeriod;
use super::task::{AxisState, AxisTask, StateEvent};
use crate::guard::terms::{GuardState, HoldReason};

/// Stop of an axis that the application commands.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum StopKind {
    /// The drive is switched off through Switched On; it stops by its 0x605C. [`AxisHandle::halt`](crate::AxisHandle::halt)
    /// brings it to rest by the ramp before. A drive that process data do not reach, or that does not stop
    /// within 30 s, is quick-stopped first.
    Disable,
    /// Quick stop by the drive's 0x605A. A drive that remains in Operation Enabled for 250 ms gets the command
    /// to stop by its 0x605C; one that remains there for two seconds loses its voltage. The drive of an axis
    /// that is not configured is switched off at rest.
    QuickStop,
    /// Quick stop, and the drive is switched off when it is at rest.
    QuickStopThenDisable,
}

impl From<StopKind> for StopCause {
    fn from(kind: StopKind) -> Self {
        match kind {
            StopKind::Disable => Self::Disable,
            StopKind::QuickStop => Self::QuickStop,
            StopKind::QuickStopThenDisable => Self::StopAll,
        }
    }
}

/// Command of the application to an axis: a call of [`AxisHandle`](crate::AxisHandle) as a value.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum AxisCommand {
    /// [`configure`](crate::AxisHandle::configure).
    Configure,
    /// [`read_position`](crate::AxisHandle::read_position).
    ReadPosition,
    /// [`enable`](crate::AxisHandle::enable).
    Enable,
    /// [`stop`](crate::AxisHandle::stop).
    Stop(StopKind),
    /// [`reset_fault`](crate::AxisHandle::reset_fault).
    ResetFault,
    /// [`recover`](crate::AxisHandle::recover).
    Recover,
    /// [`halt`](crate::AxisHandle::halt).
    Halt,
    /// [`resume`](crate::AxisHandle::resume).
    Resume,
    /// [`change_mode`](crate::AxisHandle::change_mode).
    ChangeMode(OperatingMode),
    /// [`home`](crate::AxisHandle::home).
    Home(HomingConfig),
    /// [`set_target_step`](crate::AxisHandle::set_target_step).
    TargetStep(i32),
    /// [`set_output`](crate::AxisHandle::set_output).
    Output(Output),
}

/// An axis. Each part has its own fields and reports what concerns other parts as [`AxisEvent`]; only the
/// axis applies it.
#[derive(Debug)]
pub(crate) struct Axis {
    pub(crate) plan: AxisPlan,
    pub(crate) setup: AxisSetup,
    pub(crate) link: DriveLink,
    pub(crate) path: TargetPath,
    pub(crate) data: Box<ProcessData>,
    pub(crate) task: AxisTask,
    pub(crate) report: AxisReport,
}

impl Axis {
    pub(crate) fn new(plan: AxisPlan, ramp: RampLimits, period: TargetPeriod) -> Self {
        let mode = plan.config.mode;
        let setup = AxisSetup::new();
        let limits = setup.guard_limits(&plan, mode, period.ns());
        Self {
            setup,
            link: DriveLink::new(&plan),
            path: TargetPath::new(mode, limits, ramp, period),
            data: Box::new(ProcessData::new(&plan)),
            task: AxisTask::default(),
            report: AxisReport::new(),
            plan,
        }
    }

    pub(crate) fn is_at_rest(&self) -> bool {
        self.path.is_at_rest(self.link.drive())
    }

    pub(crate) fn host_loss(&self, network: &Network) -> HostLoss {
        self.setup.host_loss(&self.plan, self.path.mode(), network)
    }

    // Settings

    /// Sets the target period, and converts the limits in units of the machine again.
    pub(crate) fn set_target_period(&mut self, period: TargetPeriod) {
        self.path.set_period(period);
        let (config, ramp) =
            self.plan.config.at_period(Duration::from_nanos(period.ns()), &mut |_| {});
        (self.plan.config, self.path.targets.limits) = (config, ramp);
        self.data.restart_feed_forward(&self.plan);
        self.set_mode(self.path.mode());
    }

    /// Sets how long a target waits: cycles from the target to its SYNC, and before in the gateway.
    pub(crate) fn set_schedule(&mut self, lead: u32, in_gateway: u16) {
        self.path.set_period(self.path.period().with_lead(lead));
        let in_drive = u16::try_from(lead).unwrap_or(u16::MAX);
        self.plan.schedule_images = in_gateway.saturating_add(in_drive);
        self.set_mode(self.path.mode());
    }

    /// Applies the rules of a mode, which the drive has confirmed or is about to.
    fn set_mode(&mut self, mode: OperatingMode) {
        let limits = self.setup.guard_limits(&self.plan, mode, self.path.period().ns());
        self.path.set_mode(mode, limits);
    }

    /// Applies the rules of a mode that the drive displays after it was written.
    fn confirm_mode(&mut self, mode: OperatingMode) {
        self.setup.set_mode_due(None);
        self.set_mode(mode);
    }

    // Commands of the application

    /// Executes a command of the application. Any command to move, enable or configure ends a recovery.
    pub(crate) fn execute(
        &mut self,
        command: AxisCommand,
        network: &mut Network,
        now_ns: u64,
    ) -> Result<(), CommandError> {
        let axis = self.plan.index;
        match command {
            AxisCommand::Configure => {
                self.task.recovery = None;
                self.request_setup(network, now_ns);
            }
            AxisCommand::ReadPosition => {
                self.begin_command()?;
                self.report.error = None;
                self.path.activate();
            }
            AxisCommand::Enable => {
                self.begin_command()?;
                self.begin_enable(now_ns);
            }
            AxisCommand::Stop(kind) => {
                self.cancel_procedure(network);
                self.stop(kind.into(), now_ns);
            }
            AxisCommand::ResetFault => {
                self.begin_command()?;
                self.report.error = None;
                let has_fault = [DriveState::Fault, DriveState::FaultReactionActive].map(Some);
                // An axis without a fault, which runs or stops, continues.
                if has_fault.contains(&self.link.drive().state) {
                    self.apply(AxisEvent::ResetFault, network, now_ns);
                }
            }
            AxisCommand::Recover if self.task.procedure.is_some() => {
                return Err(CommandError::Busy { axis });
            }
            AxisCommand::Recover => {
                self.task.recovery.get_or_insert_default();
            }
            AxisCommand::Halt => self.halt(),
            AxisCommand::Resume => self.path.targets.is_halted = false,
            AxisCommand::ChangeMode(mode) => {
                self.begin_command()?;
                let is_mapped = setup_steps::can_switch_to(&self.plan.config, mode);
                if mode == OperatingMode::Homing || !is_mapped {
                    return Err(CommandError::ModeNotMapped { axis, mode });
                }
                let mode_before = self.setup.intended_mode(self.path.mode());
                self.begin_procedure(Procedure::change_mode(mode_before, mode), now_ns);
            }
            AxisCommand::Home(homing) => {
                self.begin_command()?;
                let mode = self.setup.intended_mode(self.path.mode());
                self.begin_procedure(Procedure::home(mode, homing), now_ns);
            }
            AxisCommand::TargetStep(step) => self.plan.config.target_step = step,
            AxisCommand::Output(output) => {
                let object = output.object();
                if !self.plan.layout.has_output(object) {
                    return Err(CommandError::NotMapped { axis, output: object });
                }
                self.data.set_output(output);
            }
        }
        Ok(())
    }

    /// Begins a command that needs a configured axis without a mode change or homing; it ends a recovery.
    fn begin_command(&mut self) -> Result<(), CommandError> {
        self.task.recovery = None;
        let axis = self.plan.index;
        if !self.setup.is_complete() {
            return Err(CommandError::NotConfigured { axis });
        }
        if self.task.procedure.is_some() {
            return Err(CommandError::Busy { axis });
        }
        Ok(())
    }

    pub(crate) fn halt(&mut self) {
        self.task.recovery = None;
        self.path.targets.halt();
    }

    /// Enables the drive, after a stop that is pending.
    pub(super) fn begin_enable(&mut self, now_ns: u64) {
        if self.task.is_enabling() {
            return;
        }
        self.report.error = None;
        let follows_targets = self.path.is_running();
        if !self.task.is_stopping() && !follows_targets {
            self.path.targets.clear();
            self.path.activate();
        }
        self.task.apply(StateEvent::Enable { follows_targets }, now_ns);
    }

    fn begin_procedure(&mut self, procedure: Procedure, now_ns: u64) {
        self.report.error = None;
        self.path.targets.halt();
        let enables_after_stop =
            self.task.state().stop().is_some_and(|stop| stop.enable_since_ns.is_some());
        let then_enable = self.path.is_running() || enables_after_stop;
        self.task.procedure = Some(procedure.begin(then_enable, now_ns));
    }

    pub(crate) fn cancel_procedure(&mut self, network: &mut Network) {
        let Some(procedure) = self.task.procedure.take() else { return };
        if let Some(mode) = procedure.cancel(&self.plan, network) {
            self.setup.set_mode_due(Some(mode));
        }
    }

    /// Stops the drive in every setup and state of the axis. Cancels a command to enable that waits.
    pub(crate) fn stop(&mut self, cause: StopCause, now_ns: u64) {
        self.path.begin_stop(matches!(cause, StopCause::QuickStop | StopCause::StopAll));
        if cause.is_commanded() {
            self.task.recovery = None;
        }
        self.task.apply(StateEvent::Stop(cause), now_ns);
        if !self.is_commanded_by_process_data() {
            // The last RPDO of an earlier owner may wait in the drive for a SYNC, and its controlword
            // would enable a drive in Quick Stop Active.
            self.task.switch_off_at_rest();
        }
    }

    pub(super) fn is_commanded_by_process_data(&self) -> bool {
        self.setup.state().has_process_data() && self.path.guard().resting_target().is_some()
    }

    // Configuration of the drive

    /// Requests the configuration. It begins when all axes of the node are off.
    pub(crate) fn request_setup(&mut self, network: &mut Network, now_ns: u64) {
        self.path.stop_targets();
        self.cancel_procedure(network);
        self.setup.request(&self.plan, network);
        self.report.error = None;
        let drive = self.link.drive();
        let is_known = drive.state.is_some() && self.link.is_fresh(now_ns);
        if !drive.is_off_or_unknown() || self.task.is_enabling() {
            self.stop(StopCause::Configure, now_ns);
        } else if !is_known && !self.task.is_stopping() && self.link.contact().is_done() {
            self.link.restart_contact();
        }
    }

    pub(crate) fn begin_setup(&mut self, network: &mut Network, now_ns: u64) {
        self.link.cancel_poll(&self.plan, network);
        self.setup.begin(&self.plan, network);
        self.set_mode(self.plan.config.mode);
        self.forget_drive();
        self.task.apply(StateEvent::Configured, now_ns);
    }

    /// Takes over the values that the steps of the node read, and begins to write the mode.
    pub(crate) fn finish_steps(&mut self, network: &Network, configurator: &Configurator) {
        let mode = self.path.mode();
        if self.setup.read_back(&mut self.plan, mode, network, configurator) {
            self.set_mode(mode);
        }
        self.setup.begin_mode(&self.plan, mode);
    }

    pub(crate) fn fail_setup(&mut self, failure: StepFailure) {
        let axis = self.plan.index;
        tracing::error!(axis, "axis {axis}: configuration failed ({failure})");
        self.setup.fail();
        self.report.error = Some(AxisError::Setup(failure));
        if matches!(failure.fault, StepFault::Mismatch { .. }) {
            // The mismatch may be the statusword: a drive that was silent at the first contact is enabled.
            self.link.restart_contact();
        }
    }

    /// Ends a requested configuration that another axis of the node prevents.
    pub(crate) fn fail_requested_setup(&mut self, error: Option<AxisError>) {
        if matches!(self.setup.state(), SetupState::Requested { .. }) {
            self.setup.fail();
            self.report.error = error;
        }
    }

    /// Notes that the process data of the drive have another meaning.
    pub(super) fn lose_setup(&mut self) {
        let axis = self.plan.index;
        tracing::warn!(axis, "axis {axis}: configuration lost");
        self.path.stop_targets();
        self.setup.lose();
        self.report.error = Some(AxisError::Restarted);
        self.task.procedure = None;
        self.forget_drive();
    }

    fn forget_drive(&mut self) {
        self.link.forget_drive();
        self.setup.forget_drive();
        self.data.forget_drive();
    }

    /// Shutdown: stops the drive's watch over the host, if it has one and has stopped.
    pub(crate) fn begin_release(&mut self, has_host_heartbeat: bool, now_ns: u64) {
        let config = &self.plan.config;
        let consumes = has_host_heartbeat && config.drive.host_heartbeat_ms > 0;
        let is_guarded = config.drive.guarding.is_some();
        if (consumes || is_guarded) && self.setup.is_complete() && self.task.is_stopped() {
            let step = Step::write(object::CONSUMER_HEARTBEAT, 1, 0_u32).if_present();
            let unguarded = Step::write(object::LIFE_TIME_FACTOR, 0, 0_u8).if_present();
            let steps = [consumes.then_some(step), is_guarded.then_some(unguarded)];
            let script = axis_script(config.node_axis, steps.into_iter().flatten());
            self.setup.release_watches(consumes, is_guarded);
            self.task.apply(StateEvent::Release(script), now_ns);
        }
    }

    pub(crate) fn cancel_release(&mut self, network: &mut Network, now_ns: u64) {
        if self.task.cancel_release(&self.plan, network) {
            self.end_release(now_ns);
        }
    }

    /// Notes that the drive does not watch the host any more: it must be configured before it is enabled again.
    pub(super) fn end_release(&mut self, now_ns: u64) {
        self.task.apply(StateEvent::Released, now_ns);
        self.setup.end();
    }

    // Events

    /// Applies an event of a part.
    pub(super) fn apply(&mut self, event: AxisEvent, network: &mut Network, now_ns: u64) {
        let axis = self.plan.index;
        match event {
            AxisEvent::SetupReady => self.begin_setup(network, now_ns),
            AxisEvent::StepsDone => {
                let configurator = self.setup.take_configurator();
                self.finish_steps(network, &configurator);
                self.setup.return_configurator(configurator);
            }
            AxisEvent::SetupDone => {
                self.setup.finish(&self.plan, network);
                self.report.statistics.restart_tpdo_count();
            }
            AxisEvent::SetupFailed(failure) => self.fail_setup(failure),
            AxisEvent::NotStopped => {
                let state = self.link.drive().state;
                self.report.error = Some(AxisError::NotStopped { state });
            }
            AxisEvent::NoAnswer => {
                let is_heard = self.setup.node_share.is_heard;
                self.link.wake_node(&self.plan, network, is_heard, now_ns);
            }
            AxisEvent::ModeRestored(mode) => {
                let state = self.path.guard().state();
                let is_activated = !matches!(state, GuardState::Idle | GuardState::Holding { .. });
                self.confirm_mode(mode);
                if is_activated {
                    self.path.activate();
                }
                self.setup.begin_verification(&self.plan, mode);
            }
            AxisEvent::ConfigurationDiffers => {
                self.lose_setup();
                self.link.restart_contact();
            }
            AxisEvent::Adopt { target } => {
                let mode = self.plan.config.mode;
                self.path.expect_mode(mode);
                let script = self.setup.first_verification(&self.plan, mode);
                self.link.begin_adoption(script, target);
            }
            AxisEvent::Adopted => {
                tracing::info!(axis, "axis {axis}: enabled drive adopted");
                self.set_mode(self.plan.config.mode);
                self.task.apply(StateEvent::Configured, now_ns);
                self.data.adopt(&self.plan);
                self.setup.adopt(&self.plan, network);
                self.report.statistics.restart_tpdo_count();
            }
            AxisEvent::EnabledDriveFound => {
                tracing::warn!(axis, "axis {axis}: enabled drive found, stopping");
                self.stop(StopCause::Takeover, now_ns);
            }
            AxisEvent::SwitchOff => {
                if !self.task.is_switching_off() {
                    self.stop(StopCause::Procedure, now_ns);
                }
            }
            AxisEvent::HomingSet => {
                self.confirm_mode(OperatingMode::Homing);
                self.begin_enable(now_ns);
            }
            AxisEvent::ModeSet(mode) => self.confirm_mode(mode),
            AxisEvent::Configure if self.setup.node_share.count > 1 => {
                self.setup.node_share.is_setup_wanted = true;
            }
            AxisEvent::Configure => self.request_setup(network, now_ns),
            AxisEvent::ResetFault => {
                self.report.error = None;
                self.path.stop_targets();
                let reset = FaultReset::new(self.plan.cycles_per_sync);
                self.task.apply(StateEvent::ResetFault(reset), now_ns);
            }
            AxisEvent::Enable => self.begin_enable(now_ns),
            AxisEvent::Resume => self.path.targets.is_halted = false,
        }
    }

    /// Notes that the guard begins to hold.
    pub(super) fn on_hold(&mut self, reason: HoldReason, now_ns: u64) {
        let (axis, remedy) = (self.plan.index, reason.remedy());
        tracing::warn!(axis, remedy, "axis {axis}: holding ({reason})");
        self.report.statistics.count_hold(reason);
        if matches!(reason, HoldReason::TpdoLost(_)) {
            self.setup.require_verification();
        }
        self.report.error = Some(AxisError::Held(reason));
        self.stop_after_hold(reason, now_ns);
        if let Some(procedure) = &mut self.task.procedure {
            procedure.on_hold(reason);
        } else if *self.task.state() == AxisState::Standby
            && self.plan.config.auto_resume
            && self.path.follows_positions()
            && self.link.drive().is_enabled()
            && reason.is_on_path()
        {
            self.path.activate();
            self.task.apply(StateEvent::Resume, now_ns);
        }
    }

    /// Ends the motion for a hold. In a position mode the drive rests at its last target; in every other mode it is
    /// stopped, since it may be enabled later than its last status shows.
    fn stop_after_hold(&mut self, reason: HoldReason, now_ns: u64) {
        self.path.drop_targets();
        let must_stop = !self.path.follows_positions();
        let cause = StopCause::Held(reason);
        self.task.apply(StateEvent::Hold { cause, must_stop }, now_ns);
    }

    /// Notes a fault that the drive begins to report.
    pub(super) fn on_fault(&mut self, network: &Network, now_ns: u64) {
        self.report.statistics.faults += 1;
        let (axis, error_code) = (self.plan.index, self.plan.error_code(network));
        tracing::warn!(axis, "axis {axis}: fault (0x{error_code:04X})");
        self.report.error = Some(AxisError::Fault { error_code });
        if self.task.is_enabling() || *self.task.state() == AxisState::Active {
            self.stop_after_hold(HoldReason::LeftOperationEnabled(DriveState::Fault), now_ns);
        }
    }
}
