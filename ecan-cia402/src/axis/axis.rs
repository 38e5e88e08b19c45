//! One axis: its parts, the commands of the application, and its state in each cycle.

use std::time::Duration;

use ecan_canopen::{
    CobId, Configurator, Configuring, DriveState, Network, NmtCommand, NodeHandle, OperatingMode,
    Statusword, StepFailure, object,
};
use ecan_protocol::can::CanId;

use super::axis_state::AxisState;
use super::command_error::CommandError;
use super::config::{AxisConfig, target_kind};
use super::drive_status::DriveStatus;
use super::homing::HomingConfig;
use super::host_loss::{HostLoss, StopOptions};
use super::pdo_layout::PdoLayout;
use super::phase::{AxisError, AxisPhase};
use super::power::{FaultReset, PowerGoal};
use super::procedure::{Procedure, Stage};
use super::ramp::RampLimits;
use super::script::{mode_steps, script};
use super::set_point::SetPoint;
use super::setup_steps::{self, BusConfig};
use super::statistics::AxisStatistics;
use super::target_period::TargetPeriod;
use super::target_source::TargetSource;
use super::target_tickets::TargetTickets;
use super::verification::{Reachability, Verification};
use crate::guard::input::HoldReason;
use crate::guard::motion_guard::MotionGuard;
use crate::guard::terms::{Decision, GuardState, TargetKind};

/// Pause between two NMT start commands to a node that does not report Operational; longer than
/// its heartbeat takes to show the effect of the first one.
const START_PAUSE_NS: u64 = 500_000_000;

/// Longest time for which a drive is commanded to switch off.
const DISABLE_NS: u64 = 30_000_000_000;

#[derive(Debug)]
pub(crate) struct Axis {
    pub(crate) index: usize,
    pub(crate) config: AxisConfig,
    pub(crate) node: NodeHandle,
    pub(crate) rpdo: CanId,
    pub(crate) layout: PdoLayout,
    pub(crate) cycles_per_sync: u32,
    /// New images, beyond those of the configuration, that a scheduled target may wait in the
    /// gateway.
    pub(crate) schedule_images: u16,
    pub(crate) state: AxisState,
    pub(crate) guard: MotionGuard,
    /// Mode that the drive has confirmed, or that is being written.
    pub(crate) mode: OperatingMode,
    pub(crate) drive: DriveStatus,
    pub(crate) targets: TargetSource,
    pub(crate) set_point: SetPoint,
    pub(crate) tickets: TargetTickets,
    /// The gateway reported a target as not sent since the last cycle.
    pub(crate) target_lost: bool,
    pub(crate) decision: Decision,
    pub(crate) target_period: TargetPeriod,
    pub(crate) procedure: Option<Procedure>,
    pub(crate) verification: Verification,
    pub(crate) reachability: Reachability,
    pub(crate) configurator: Configurator,
    /// Read back at the end of the configuration.
    pub(crate) stop_options: Option<StopOptions>,
    /// SDO requests without an answer when the configuration began.
    silences: u64,
    /// Boot-up messages when the configuration was complete.
    pub(crate) boot_ups: u32,
    /// Earliest time of the next NMT start command.
    next_start_ns: u64,
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
        cycles_per_sync: u32,
        target_cycles: u32,
    ) -> Self {
        let id = config.address.node;
        let mode = config.mode;
        Self {
            index,
            node,
            rpdo: CobId::rpdo(id, config.pdo_number).can_id(),
            layout: config.layout(),
            cycles_per_sync,
            schedule_images: 0,
            state: AxisState::default(),
            guard: MotionGuard::new(config.guard_limits(mode, cycles_per_sync)),
            mode,
            drive: DriveStatus::default(),
            targets: TargetSource::new(ramp),
            set_point: SetPoint::default(),
            tickets: TargetTickets::default(),
            target_lost: false,
            decision: Decision::Closed,
            target_period: TargetPeriod::new(target_cycles),
            procedure: None,
            verification: Verification::default(),
            reachability: Reachability::default(),
            configurator: Configurator::new(),
            stop_options: None,
            silences: 0,
            boot_ups: 0,
            next_start_ns: 0,
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

    /// Whether the application's targets can or do reach the drive.
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

    pub(crate) fn configure(
        &mut self,
        network: &mut Network,
        bus: &BusConfig,
    ) -> Result<(), CommandError> {
        let steps = setup_steps::steps(&self.config, bus)
            .map_err(|error| CommandError::Mapping { axis: self.index, error })?;
        self.stop_targets();
        self.cancel_procedure(network);
        self.configurator.clear(network);
        self.stop_options = None;
        self.configurator.add(network, self.node, steps);
        self.set_mode(self.config.mode);
        self.silences = network.sdo_silences(self.node);
        self.verification = Verification::Complete;
        self.error = None;
        self.drive.forget();
        self.state = AxisState::Configuring;
        Ok(())
    }

    /// Forgets all targets; the axis does not become active again by itself.
    fn stop_targets(&mut self) {
        self.guard.release();
        self.targets.clear();
    }

    fn ready_for_commands(&self) -> Result<(), CommandError> {
        if !self.state.is_configured() {
            return Err(CommandError::NotConfigured { axis: self.index });
        }
        if self.procedure.is_some() {
            return Err(CommandError::Busy { axis: self.index });
        }
        Ok(())
    }

    pub(crate) fn read_position(&mut self) -> Result<(), CommandError> {
        self.ready_for_commands()?;
        self.error = None;
        self.guard.activate();
        Ok(())
    }

    pub(crate) fn enable(&mut self, now_ns: u64) -> Result<(), CommandError> {
        self.ready_for_commands()?;
        self.begin_enable(now_ns);
        Ok(())
    }

    pub(crate) fn begin_enable(&mut self, now_ns: u64) {
        if self.state.enabling_since_ns().is_some() {
            return;
        }
        self.error = None;
        if self.is_running() {
            self.state = AxisState::Active;
        } else {
            self.targets.clear();
            self.guard.activate();
            self.state = AxisState::Enabling { since_ns: now_ns };
        }
    }

    pub(crate) fn disable(&mut self) {
        self.stop_targets();
        if self.state.is_configured() {
            self.state = AxisState::Off;
        }
    }

    pub(crate) fn quick_stop(&mut self) {
        self.stop_targets();
        self.guard.hold();
        if self.state.is_configured() {
            self.state = AxisState::QuickStop;
        }
    }

    pub(crate) fn reset_fault(&mut self) -> Result<(), CommandError> {
        self.ready_for_commands()?;
        self.stop_targets();
        self.error = None;
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
        self.begin_procedure(self.mode, Some(homing), now_ns);
        Ok(())
    }

    fn begin_procedure(&mut self, mode: OperatingMode, homing: Option<HomingConfig>, now_ns: u64) {
        self.error = None;
        self.targets.halt();
        let then_enable = self.is_running();
        self.procedure = Some(Procedure::new((self.mode, mode), homing, then_enable, now_ns));
    }

    pub(crate) fn cancel_procedure(&mut self, network: &mut Network) {
        if let Some(procedure) = self.procedure.take()
            && let Stage::Writing(script) | Stage::Restoring(script) = procedure.stage
        {
            script.cancel(network, self.node);
        }
    }

    /// Converts the limits in units of the machine again.
    pub(crate) fn convert_limits(&mut self, target_period: Duration) {
        let (config, ramp) = self.config.at_period(target_period, &mut |_| {});
        (self.config, self.targets.limits) = (config, ramp);
        self.set_mode(self.mode);
    }

    /// Applies the rules of a mode, which the drive has confirmed or is about to.
    pub(crate) fn set_mode(&mut self, mode: OperatingMode) {
        self.mode = mode;
        let mut limits = self.config.guard_limits(mode, self.cycles_per_sync);
        limits.drain_images = limits.drain_images.saturating_add(self.schedule_images);
        self.guard.set_limits(limits);
    }

    /// Shutdown: stops the drive's watch over the host's heartbeat, if it has one.
    pub(crate) fn begin_release(&mut self, has_host_heartbeat: bool) {
        let watches = has_host_heartbeat && self.config.drive.host_heartbeat_ms > 0;
        if watches && self.state.is_configured() {
            let step = ecan_canopen::Step::write(object::CONSUMER_HEARTBEAT, 1, 0_u32);
            if let Some([released, _]) = self.stop_options.as_mut().map(|it| &mut it.watches) {
                *released = None;
            }
            self.state = AxisState::Releasing(script([step.if_present()]));
        }
    }

    pub(crate) fn cancel_release(&mut self, network: &mut Network) {
        if let AxisState::Releasing(script) = self.state {
            script.cancel(network, self.node);
            self.state = AxisState::Off;
        }
    }

    // Events

    pub(crate) fn held(&mut self, reason: HoldReason) {
        tracing::warn!(axis = self.index, "axis {}: holding ({reason})", self.index);
        self.statistics.held(reason);
        if matches!(reason, HoldReason::TpdoLost(_)) {
            self.require_verification();
        }
        self.error = Some(AxisError::Held(reason));
        self.stop_after_hold();
        let stands = target_kind(self.mode) == TargetKind::Position;
        if self.state == AxisState::Standby
            && self.config.auto_resume
            && stands
            && self.drive.is_enabled()
            && reason.is_on_path()
        {
            self.guard.activate();
            self.state = AxisState::Resuming;
        }
    }

    fn stop_after_hold(&mut self) {
        self.targets.requested = None;
        self.targets.stop();
        let continues = target_kind(self.mode) != TargetKind::Position;
        self.state = self.state.after_hold(continues && self.drive.is_enabled());
    }

    pub(crate) fn faulted(&mut self, network: &Network) {
        self.statistics.faults += 1;
        let error_code = self.error_code(network);
        tracing::warn!(axis = self.index, "axis {}: fault (0x{error_code:04X})", self.index);
        self.error = Some(AxisError::Fault { error_code });
        if self.state.power_goal() == PowerGoal::Enabled {
            self.stop_after_hold();
        }
    }

    pub(crate) fn require_verification(&mut self) {
        if self.state.is_configured() && self.verification == Verification::Complete {
            self.verification = Verification::Due { from_ns: 0 };
        }
    }

    /// The drive has lost its configuration: its process data have another meaning.
    pub(crate) fn restarted(&mut self) {
        tracing::warn!(axis = self.index, "axis {}: configuration lost", self.index);
        self.stop_targets();
        self.state = AxisState::Unconfigured;
        self.verification = Verification::Complete;
        self.error = Some(AxisError::Restarted);
        self.procedure = None;
        self.stop_options = None;
        self.drive.forget();
    }

    pub(crate) fn setup_failed(&mut self, failure: StepFailure) {
        tracing::error!(axis = self.index, "axis {}: configuration failed ({failure})", self.index);
        self.state = AxisState::SetupFailed;
        self.error = Some(AxisError::Setup(failure));
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

    // Each cycle

    pub(crate) fn step_state(&mut self, network: &mut Network, now_ns: u64) {
        let elapsed_ns = |since_ns: u64| now_ns.saturating_sub(since_ns);
        match &mut self.state {
            AxisState::Configuring => match self.configurator.step(network, now_ns) {
                Configuring::Running => {}
                Configuring::Done => {
                    self.state = AxisState::SettingMode(script(mode_steps(self.mode)));
                }
                Configuring::Failed(failure) => self.setup_failed(failure),
            },
            AxisState::SettingMode(script) => {
                match script.advance(network, self.node, now_ns, |_, _, _| {}) {
                    Configuring::Running => {}
                    Configuring::Done => self.finish_setup(network),
                    Configuring::Failed(failure) => self.setup_failed(failure),
                }
            }
            AxisState::Enabling { since_ns } | AxisState::ReEnabling { since_ns } => {
                let since_ns = *since_ns;
                let is_off = self.drive.state == Some(DriveState::SwitchOnDisabled);
                let waited = Duration::from_nanos(elapsed_ns(since_ns));
                if self.drive.is_in_fault() {
                    let error_code = self.error_code(network);
                    self.error = Some(AxisError::Fault { error_code });
                    self.stop_targets();
                    self.state = AxisState::Standby;
                } else if waited > self.config.enable_timeout {
                    let (state, guard) = (self.drive.state, self.guard.state());
                    self.error = Some(AxisError::EnableTimedOut { state, guard, waited });
                    self.disable();
                } else if is_off {
                    self.state = AxisState::Enabling { since_ns };
                }
            }
            AxisState::Resuming => {
                // Enabling a drive that left Operation Enabled is the application's command.
                if !self.drive.is_enabled() {
                    self.guard.release();
                    self.state = AxisState::Standby;
                }
            }
            AxisState::Off => {
                if !self.drive.is_off() {
                    self.state = AxisState::SwitchingOff { since_ns: now_ns };
                }
            }
            AxisState::SwitchingOff { since_ns } => {
                if self.drive.is_off() {
                    self.state = AxisState::Off;
                } else if elapsed_ns(*since_ns) > DISABLE_NS {
                    let not_disabled = AxisError::NotDisabled { state: self.drive.state };
                    self.error = self.error.or(Some(not_disabled));
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
                    Configuring::Done | Configuring::Failed(_) => self.state = AxisState::Off,
                }
            }
            AxisState::Unconfigured
            | AxisState::SetupFailed
            | AxisState::Standby
            | AxisState::Active
            | AxisState::QuickStop => {}
        }
    }

    fn finish_setup(&mut self, network: &mut Network) {
        self.state = AxisState::Standby;
        let producer = object::PRODUCER_HEARTBEAT;
        // The value that was written and read back; none if the drive has no heartbeat.
        let period_ms = self.configurator.uploaded(self.node, producer, 0).unwrap_or_default();
        let timeout = Duration::from_millis(period_ms.saturating_mul(7) / 2);
        network.set_heartbeat_timeout(self.node, timeout);
        self.boot_ups = network.status(self.node).map_or(0, |status| status.boot_ups);
        self.read_back_stop_options(network);
        self.statistics.restart_tpdo_count();
        if network.sdo_silences(self.node) != self.silences {
            // The drive may have restarted in between, and lost the first steps.
            self.require_verification();
        }
    }

    fn read_back_stop_options(&mut self, network: &Network) {
        let value = |index, subindex| self.configurator.uploaded(self.node, index, subindex);
        self.stop_options = Some(StopOptions::from_values(value));
        let loss = self.host_loss(network);
        if !loss.reaction.is_controlled_stop() {
            tracing::warn!(axis = self.index, "{loss}");
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
        let is_used = self.state.is_commanding()
            || matches!(self.guard.state(), GuardState::Draining | GuardState::Reading);
        let is_stopped =
            !self.reachability.operational && self.verification == Verification::Complete;
        if is_used && is_stopped && self.state.is_configured() && now_ns >= self.next_start_ns {
            self.next_start_ns = now_ns.saturating_add(START_PAUSE_NS);
            // If the queue is full, the next attempt follows after the pause.
            let _ = network.nmt(self.node, NmtCommand::Start);
        }
    }

    pub(crate) fn error_code(&self, network: &Network) -> u16 {
        let last = network.emcy(self.node).and_then(|log| log.last());
        last.map_or(0, |record| record.emcy.code)
    }
}
