//! One axis: its parts, and the commands of the application.

use std::time::Duration;

use ecan_canopen::{
    Configurator, Controlword, DriveState, EmcyLog, Heartbeat, Network, NmtCommand, NmtState,
    NodeHandle, OperatingMode, Statusword, Step, object,
};
use ecan_protocol::can::CanId;

use super::axis_state::AxisState;
use super::config::{AxisConfig, target_kind};
use super::drive_status::DrivePoll;
use super::drive_status::DriveStatus;
use super::error::CommandError;
use super::homing::HomingConfig;
use super::host_loss::{HostLoss, StopOptions};
use super::pdo_layout::CommandLayout;
use super::power::{FaultReset, StopCause};
use super::procedure::{Procedure, Stage};
use super::process_data::FurtherData;
use super::ramp::RampLimits;
use super::recovery::Recovery;
use super::script::axis_script;
use super::setup::{NodeShare, Reachability, SetupState, Verification};
use super::setup_steps;
use super::status::{AxisError, AxisPhase, AxisStatistics};
use super::takeover::{Inspection, Takeover, TakeoverState};
use super::target_path::{AnswerWatch, SetPoint, TargetTickets};
use super::target_period::TargetPeriod;
use super::target_source::TargetSource;
use super::units::ScaleSource;
use crate::guard::feed_forward::FeedForwardGuard;
use crate::guard::motion_guard::MotionGuard;
use crate::guard::terms::{Decision, GuardState, HoldReason, TargetKind};

/// Pause between two equal NMT commands to a node that does not report their effect; longer than
/// its heartbeat takes to show the effect of the first one.
const NMT_PAUSE_NS: u64 = 500_000_000;

/// Least time for which a reported status counts as present: a round of SDO transfers.
const FRESH_NS: u64 = 100_000_000;

/// The same in SYNC periods.
const FRESH_PERIODS: u64 = 15;

#[derive(Debug)]
pub(crate) struct Axis {
    pub(crate) index: usize,
    pub(crate) config: AxisConfig,
    pub(crate) node: NodeHandle,
    pub(crate) rpdo: CanId,
    pub(crate) command_layout: CommandLayout,
    /// The TPDOs carry further objects, or there are RPDOs after the first.
    pub(crate) is_extended: bool,
    pub(crate) has_auxiliary: bool,
    pub(crate) further: Box<FurtherData>,
    pub(crate) cycles_per_sync: u32,
    /// New images, beyond those of the configuration, that a scheduled target may wait in the
    /// gateway.
    pub(crate) schedule_images: u16,
    pub(crate) setup: SetupState,
    pub(crate) state: AxisState,
    pub(crate) takeover: TakeoverState,
    /// Treatment of an enabled drive at the first contact.
    pub(crate) takeover_policy: Takeover,
    /// The first contact with the drive is not complete: its channel gets neither SYNC nor heartbeats.
    pub(crate) is_uninspected: bool,
    pub(crate) poll: DrivePoll,
    pub(crate) inspection: Inspection,
    pub(crate) guard: MotionGuard,
    /// Mode that the drive has confirmed, or that is being written.
    pub(crate) mode: OperatingMode,
    pub(crate) drive: DriveStatus,
    /// Longest age of a present status.
    pub(crate) fresh_ns: u64,
    pub(crate) targets: TargetSource,
    pub(crate) set_point: SetPoint,
    pub(crate) answers: AnswerWatch,
    pub(crate) tickets: TargetTickets,
    /// The gateway reported a target as not sent since the last cycle.
    pub(crate) target_lost: bool,
    pub(crate) decision: Decision,
    pub(crate) target_period: TargetPeriod,
    pub(crate) procedure: Option<Procedure>,
    /// A procedure was cancelled after it had begun to write a mode: this one is written before the
    /// drive is enabled.
    pub(crate) mode_due: Option<OperatingMode>,
    pub(crate) recovery: Option<Recovery>,
    pub(crate) verification: Verification,
    /// The PDOs that it reads, from 0 on.
    pub(crate) verification_stage: usize,
    pub(crate) reachability: Reachability,
    pub(crate) node_share: NodeShare,
    /// Holds the steps of the configuration of the node, if the axis is the first of it.
    pub(crate) configurator: Configurator,
    /// Producer heartbeat time, read back at the end of the configuration.
    pub(crate) heartbeat_ms: Option<u64>,
    /// Read back at the end of the configuration.
    pub(crate) stop_options: Option<StopOptions>,
    /// SDO requests without an answer when the configuration began.
    pub(crate) silences: u64,
    /// Boot-up messages when the configuration was complete.
    pub(crate) boot_ups: u32,
    /// Command that was sent last, unless a target was.
    pub(crate) last_command: Option<Controlword>,
    /// Earliest time of the next NMT start command.
    next_start_ns: u64,
    /// Earliest time of the next NMT command to a node that may be in Stopped.
    next_wake_ns: u64,
    pub(crate) statistics: AxisStatistics,
    pub(crate) error: Option<AxisError>,
    pub(crate) phase: AxisPhase,
    pub(crate) phase_since_ns: u64,
}

impl Axis {
    pub(crate) fn new(
        index: usize,
        (config, ramp): (AxisConfig, RampLimits),
        node: NodeHandle,
        (cycles_per_sync, sync_period_ns): (u32, u64),
        target_period: TargetPeriod,
        takeover_policy: Takeover,
    ) -> Self {
        let mode = config.mode;
        let further = Box::new(FurtherData::new(&config));
        Self {
            index,
            node,
            rpdo: config.rpdo_id(0),
            command_layout: further.layout.command(),
            is_extended: further.layout.is_extended() || config.scale_source == ScaleSource::Drive,
            has_auxiliary: !further.auxiliary.is_empty(),
            further,
            cycles_per_sync,
            schedule_images: 0,
            setup: SetupState::default(),
            state: AxisState::default(),
            takeover: TakeoverState::default(),
            takeover_policy,
            is_uninspected: true,
            poll: DrivePoll::new(config.node_axis),
            inspection: Inspection::default(),
            guard: MotionGuard::new(config.guard_limits(mode, cycles_per_sync)),
            mode,
            drive: DriveStatus::default(),
            fresh_ns: FRESH_NS.max(sync_period_ns.saturating_mul(FRESH_PERIODS)),
            targets: TargetSource::new(ramp),
            set_point: SetPoint::default(),
            answers: AnswerWatch::default(),
            tickets: TargetTickets::default(),
            target_lost: false,
            decision: Decision::Closed,
            target_period,
            procedure: None,
            mode_due: None,
            recovery: None,
            verification: Verification::default(),
            verification_stage: 0,
            reachability: Reachability::default(),
            node_share: NodeShare::default(),
            configurator: Configurator::new(),
            heartbeat_ms: None,
            stop_options: None,
            silences: 0,
            boot_ups: 0,
            last_command: None,
            next_start_ns: 0,
            next_wake_ns: 0,
            statistics: AxisStatistics::default(),
            error: None,
            phase: AxisPhase::NotConfigured,
            phase_since_ns: 0,
            config,
        }
    }

    pub(crate) fn target(&self) -> Option<i32> {
        match self.guard.state() {
            GuardState::Running { target } => Some(target),
            _ => None,
        }
    }

    pub(crate) fn is_running(&self) -> bool {
        self.target().is_some()
    }

    /// Returns whether the axis follows the application's targets.
    pub(crate) fn follows_application(&self) -> bool {
        self.is_running() && !self.targets.is_halted
    }

    /// Returns whether the application's targets can or do reach the drive.
    pub(crate) fn is_active(&self) -> bool {
        matches!(self.guard.state(), GuardState::Armed { .. } | GuardState::Running { .. })
    }

    pub(crate) fn is_at_rest(&self) -> bool {
        self.target().is_none_or(|target| match target_kind(self.mode) {
            TargetKind::Position => self.targets.is_at_rest(),
            TargetKind::Rate => target == 0,
            // The drive generates its own motion, and reports its end.
            TargetKind::Profile => self.drive.has(Statusword::TARGET_REACHED),
            TargetKind::None => true,
        })
    }

    // Commands of the application and of procedures

    /// Forgets all targets; the axis does not become active again by itself.
    pub(crate) fn stop_targets(&mut self) {
        self.guard.release();
        self.targets.clear();
    }

    /// Every command of the application but a stop begins here; it ends a recovery.
    fn ready_for_commands(&mut self) -> Result<(), CommandError> {
        self.recovery = None;
        if !self.setup.is_complete() {
            return Err(CommandError::NotConfigured { axis: self.index });
        }
        if self.procedure.is_some() {
            return Err(CommandError::Busy { axis: self.index });
        }
        Ok(())
    }

    pub(crate) fn halt(&mut self) {
        self.recovery = None;
        self.targets.halt();
    }

    pub(crate) fn read_position(&mut self) -> Result<(), CommandError> {
        self.ready_for_commands()?;
        self.error = None;
        self.guard.activate();
        Ok(())
    }

    /// Starts a recovery, unless one runs.
    pub(crate) fn recover(&mut self) -> Result<(), CommandError> {
        if self.procedure.is_some() {
            return Err(CommandError::Busy { axis: self.index });
        }
        self.recovery.get_or_insert_default();
        Ok(())
    }

    pub(crate) fn enable(&mut self, now_ns: u64) -> Result<(), CommandError> {
        self.ready_for_commands()?;
        self.begin_enable(now_ns);
        Ok(())
    }

    /// Enables the drive, after a stop that is pending.
    pub(crate) fn begin_enable(&mut self, now_ns: u64) {
        if self.state.enabling_since_ns().is_some() {
            return;
        }
        self.error = None;
        if let AxisState::Stopping(stop) = &mut self.state {
            stop.enable_since_ns = Some(now_ns);
        } else if self.is_running() {
            self.state = AxisState::Active;
        } else {
            self.targets.clear();
            self.guard.activate();
            self.state = AxisState::Enabling { since_ns: now_ns };
        }
    }

    pub(crate) fn reset_fault(&mut self) -> Result<(), CommandError> {
        self.ready_for_commands()?;
        self.error = None;
        let has_fault = [DriveState::Fault, DriveState::FaultReactionActive].map(Some);
        if !has_fault.contains(&self.drive.state) {
            // An axis that runs or stops continues.
            return Ok(());
        }
        self.stop_targets();
        self.state = AxisState::ResettingFault(FaultReset::new(self.cycles_per_sync));
        Ok(())
    }

    pub(crate) fn change_mode(
        &mut self,
        mode: OperatingMode,
        now_ns: u64,
    ) -> Result<(), CommandError> {
        self.ready_for_commands()?;
        if mode == OperatingMode::Homing || !setup_steps::can_switch_to(&self.config, mode) {
            return Err(CommandError::ModeNotMapped { axis: self.index, mode });
        }
        self.begin_procedure(mode, None, now_ns);
        Ok(())
    }

    pub(crate) fn home(&mut self, homing: HomingConfig, now_ns: u64) -> Result<(), CommandError> {
        self.ready_for_commands()?;
        self.begin_procedure(self.intended_mode(), Some(homing), now_ns);
        Ok(())
    }

    /// Starts a mode change, or with `homing` a homing that returns to `mode`.
    fn begin_procedure(&mut self, mode: OperatingMode, homing: Option<HomingConfig>, now_ns: u64) {
        self.error = None;
        self.targets.halt();
        let is_queued = self.state.stop().is_some_and(|stop| stop.enable_since_ns.is_some());
        let then_enable = self.is_running() || is_queued;
        let modes = (self.intended_mode(), mode);
        self.procedure = Some(Procedure::new(modes, homing, then_enable, now_ns));
    }

    /// The mode in which the axis follows targets.
    fn intended_mode(&self) -> OperatingMode {
        self.mode_due.unwrap_or(self.mode)
    }

    pub(crate) fn cancel_procedure(&mut self, network: &mut Network) {
        let Some(procedure) = self.procedure.take() else { return };
        if let Stage::Writing(script) | Stage::Restoring(script) = procedure.stage {
            script.cancel(network, self.node);
        }
        if procedure.stage != Stage::Disabling {
            self.mode_due = Some(procedure.mode_before);
        }
    }

    /// Converts the limits in units of the machine again.
    pub(crate) fn convert_limits(&mut self, target_period: Duration) {
        let (config, ramp) = self.config.at_period(target_period, &mut |_| {});
        (self.config, self.targets.limits) = (config, ramp);
        self.further.feed_forward = FeedForwardGuard::new(self.config.feed_forward);
        self.set_mode(self.mode);
    }

    /// The drive displays the mode that was written.
    pub(crate) fn confirm_mode(&mut self, mode: OperatingMode) {
        self.mode_due = None;
        self.set_mode(mode);
    }

    /// Applies the rules of a mode, which the drive has confirmed or is about to.
    pub(crate) fn set_mode(&mut self, mode: OperatingMode) {
        self.mode = mode;
        let mut limits = self.config.guard_limits(mode, self.cycles_per_sync);
        if let Some((drive, units)) = self.further.limits.zip(self.further.units) {
            let period_ns = self.target_period.ns();
            drive.narrow(&mut limits, (mode, &self.config), &units, period_ns);
        }
        limits.drain_images = limits.drain_images.saturating_add(self.schedule_images);
        self.guard.set_limits(limits);
    }

    /// Shutdown: stops the drive's watch over the host, if it has one and has stopped.
    pub(crate) fn begin_release(&mut self, has_host_heartbeat: bool) {
        let consumes = has_host_heartbeat && self.config.drive.host_heartbeat_ms > 0;
        let is_guarded = self.config.drive.guarding.is_some();
        if (consumes || is_guarded)
            && self.setup.is_complete()
            && matches!(self.state, AxisState::Stopped(_))
        {
            if let Some(options) = &mut self.stop_options {
                let [released, _] = &mut options.watches;
                *released = released.filter(|_| !consumes);
                options.guarding = options.guarding.filter(|_| !is_guarded);
            }
            let step = Step::write(object::CONSUMER_HEARTBEAT, 1, 0_u32).if_present();
            let unguarded = Step::write(object::LIFE_TIME_FACTOR, 0, 0_u8).if_present();
            let steps = [consumes.then_some(step), is_guarded.then_some(unguarded)];
            let steps = steps.into_iter().flatten();
            self.state = AxisState::Releasing(axis_script(self.config.node_axis, steps));
        }
    }

    pub(crate) fn cancel_release(&mut self, network: &mut Network) {
        if let AxisState::Releasing(script) = self.state {
            script.cancel(network, self.node);
            self.released();
        }
    }

    /// The drive does not watch the host any more: it must be configured before it is enabled again.
    pub(crate) fn released(&mut self) {
        self.state = AxisState::Standby;
        self.setup = SetupState::Unconfigured;
    }

    // Events

    pub(crate) fn held(&mut self, reason: HoldReason, now_ns: u64) {
        let remedy = reason.remedy();
        tracing::warn!(axis = self.index, remedy, "axis {}: holding ({reason})", self.index);
        self.statistics.held(reason);
        if matches!(reason, HoldReason::TpdoLost(_)) {
            self.require_verification();
        }
        self.error = Some(AxisError::Held(reason));
        self.stop_after_hold(reason, now_ns);
        if let Some(procedure) = &mut self.procedure {
            procedure.held(reason);
        } else if self.state == AxisState::Standby
            && self.config.auto_resume
            && target_kind(self.mode) == TargetKind::Position
            && self.drive.is_enabled()
            && reason.is_on_path()
        {
            self.guard.activate();
            self.state = AxisState::Resuming;
        }
    }

    /// In a position mode the drive rests at its last target; in every other mode it is stopped,
    /// since it may be enabled later than its last status shows.
    fn stop_after_hold(&mut self, reason: HoldReason, now_ns: u64) {
        self.targets.request(None, None);
        self.targets.stop();
        let must_stop = target_kind(self.mode) != TargetKind::Position;
        self.state = self.state.after_hold(StopCause::Held(reason), must_stop, now_ns);
    }

    pub(crate) fn faulted(&mut self, network: &Network, now_ns: u64) {
        self.statistics.faults += 1;
        let error_code = self.error_code(network);
        tracing::warn!(axis = self.index, "axis {}: fault (0x{error_code:04X})", self.index);
        self.error = Some(AxisError::Fault { error_code });
        if self.state.enabling_since_ns().is_some() || self.state == AxisState::Active {
            self.stop_after_hold(HoldReason::LeftOperationEnabled(DriveState::Fault), now_ns);
        }
    }

    pub(crate) fn require_verification(&mut self) {
        match &mut self.setup {
            // The configuration that follows verifies it.
            SetupState::Requested { is_configured } => *is_configured = false,
            SetupState::Unconfigured | SetupState::Failed => {}
            SetupState::Complete | SetupState::Configuring | SetupState::SettingMode(_) => {
                if self.verification == Verification::Complete {
                    self.verification = Verification::Due { from_ns: 0 };
                }
            }
        }
    }

    pub(crate) fn activated(&mut self) {
        tracing::info!(axis = self.index, "axis {}: active", self.index);
        self.statistics.activations += 1;
        self.statistics.targets_sent += 1;
        self.targets.stop();
        if let AxisState::Enabling { .. } | AxisState::Resuming = self.state {
            self.state = AxisState::Active;
        }
        if matches!(self.error, Some(AxisError::Held(_))) {
            self.error = None;
        }
    }

    /// The enabled drive holds a target from which its actual position would be a jump. When
    /// switched off, it drops that target. An axis that resumes by itself is not switched off.
    pub(crate) fn old_target_found(&mut self) {
        match self.state {
            AxisState::Resuming => {
                self.guard.release();
                self.state = AxisState::Standby;
            }
            AxisState::Enabling { since_ns } => self.state = AxisState::ReEnabling { since_ns },
            _ => {}
        }
    }

    pub(crate) fn host_loss(&self, network: &Network) -> HostLoss {
        let host = network.host_heartbeat().map(|heartbeat| heartbeat.node);
        let address = (self.index, self.config.address);
        HostLoss::new(address, self.mode, self.stop_options.as_ref(), host)
    }

    /// Starts a node that lost the host's heartbeat: it is in Pre-operational (CiA 301, 0x1029)
    /// and remains there until it receives the NMT command. Only if the axis is in use and its
    /// configuration is verified.
    pub(crate) fn start_node(&mut self, network: &mut Network, now_ns: u64) {
        let is_used = self.state.needs_operational()
            || matches!(self.guard.state(), GuardState::Draining | GuardState::Reading);
        // Without heartbeat only missing TPDOs show it.
        let reports_state = network.status(self.node).is_some_and(|it| it.nmt_state.is_some());
        let is_silent = !reports_state && !self.drive.is_fresh(now_ns, self.fresh_ns);
        let is_stopped = (!self.reachability.operational || is_silent)
            && self.verification == Verification::Complete;
        if is_used && is_stopped && self.setup.is_complete() && now_ns >= self.next_start_ns {
            self.next_start_ns = now_ns.saturating_add(NMT_PAUSE_NS);
            // If the queue is full, the next attempt follows after the pause.
            let _ = network.nmt(self.node, NmtCommand::Start);
        }
    }

    /// Commands Pre-operational to a node that does not answer SDO requests and is, or may be, in NMT
    /// Stopped, where it has no SDO server. Without a life sign nothing reports that state, and another
    /// master may have commanded it; a node that sends TPDOs is not in it.
    pub(crate) fn wake_node(&mut self, network: &mut Network, now_ns: u64) {
        let Some(status) = network.status(self.node) else { return };
        let is_unwatched = matches!(status.heartbeat, Heartbeat::Unconfigured | Heartbeat::Unknown);
        let is_silent = !self.drive.is_fresh(now_ns, self.fresh_ns) && !self.node_share.is_heard;
        let may_be_stopped = status.nmt_state == Some(NmtState::Stopped)
            || is_unwatched && is_silent && self.reachability.gateway;
        if may_be_stopped && now_ns >= self.next_wake_ns {
            self.next_wake_ns = now_ns.saturating_add(NMT_PAUSE_NS);
            // If the queue is full, the next attempt follows after the pause.
            let _ = network.nmt(self.node, NmtCommand::EnterPreOperational);
        }
    }

    pub(crate) fn error_code(&self, network: &Network) -> u16 {
        network.emcy(self.node).map_or(0, EmcyLog::last_code)
    }
}
