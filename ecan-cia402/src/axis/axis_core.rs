//! One axis: everything that is kept of it, and the commands to it.

use ecan_canopen::{
    CobId, Configurator, DriveState, Network, NodeHandle, OperatingMode, Statusword, StepFailure,
};
use ecan_mcan_port::SendTicket;
use ecan_protocol::can::CanId;

use super::error::CommandError;
use super::guard::MotionGuard;
use super::guard_terms::{Decision, GuardState, TargetKind};
use super::homing::HomingConfig;
use super::homing::HomingState;
use super::pdo_layout::{Feedback, PdoLayout};
use super::phase::{AxisError, AxisPhase, AxisProgress};
use super::power::{PowerControl, PowerGoal, ResetState};
use super::procedure::{Procedure, Stage};
use super::ramp::Ramp;
use super::script::Script;
use super::set_point::SetPoint;
use super::settings::{AxisConfig, target_kind};
use super::start_up::{self, BusConfig};
use super::statistics::AxisStatistics;

/// Sends whose results are still awaited.
const TICKETS: usize = 8;

/// How the configuration of an axis stands.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Setup {
    /// Not begun, or forgotten by the drive.
    None,
    /// The steps run.
    Steps,
    /// The mode is written.
    Mode(Script),
    /// Done.
    Done,
    /// Failed.
    Failed(StepFailure),
}

/// Whether a drive that was out of sight still has its configuration. It may have restarted where
/// nobody saw its boot-up message, and then its process data mean something else.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) enum Reverification {
    /// It was never out of sight.
    #[default]
    None,
    /// It is to be asked, from this time on.
    Open { from_ns: u64 },
    /// It is being asked.
    Asking(Script),
}

/// What of a drive is in sight.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct Reachability {
    /// Its gateway is in service.
    pub(super) in_service: bool,
    /// Its heartbeat has not timed out.
    pub(super) heard: bool,
    /// It is in Operational, as far as is known.
    pub(super) operational: bool,
}

/// What the axis does with its targets by itself.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) enum Motion {
    /// The application's targets.
    #[default]
    Free,
    /// To rest by the ramp, and there.
    Halt,
}

/// One axis.
#[derive(Debug)]
pub(super) struct Axis {
    pub(super) index: usize,
    pub(super) settings: AxisConfig,
    pub(super) node: NodeHandle,
    pub(super) rpdo: CanId,
    pub(super) layout: PdoLayout,
    pub(super) cycles_per_sync: u32,
    /// New images, beyond those of the settings, that a scheduled target may wait in the gateway.
    pub(super) schedule_images: u16,
    pub(super) guard: MotionGuard,
    pub(super) power: PowerControl,
    /// The mode that the drive has confirmed, or is being told.
    pub(super) mode: OperatingMode,
    pub(super) set_point: SetPoint,
    pub(super) ramp: Ramp,
    pub(super) motion: Motion,
    pub(super) wanted: Option<i32>,
    pub(super) setup: Setup,
    pub(super) configurator: Configurator,
    /// SDO requests that the drive had left unanswered when its configuration was begun.
    pub(super) silences: u64,
    pub(super) procedure: Option<Procedure>,
    /// Tells the drive not to wait for the host any more.
    pub(super) release: Option<Script>,
    /// An axis that held takes itself up again, as long as its drive stays enabled.
    pub(super) resumes: bool,
    /// The drive is switched off to be enabled anew.
    pub(super) re_enables: bool,
    /// When enabling was commanded.
    pub(super) enabling_since_ns: Option<u64>,
    /// Since when the drive has been told to switch off.
    pub(super) disabling_since_ns: Option<u64>,
    /// The newest TPDO of this cycle.
    pub(super) arrived: Option<Feedback>,
    pub(super) statusword: Option<Statusword>,
    pub(super) state: Option<DriveState>,
    pub(super) boot_ups: u32,
    /// What of the drive was in sight in the last cycle.
    pub(super) sight: Reachability,
    /// Whether the drive still has its configuration.
    pub(super) doubt: Reverification,
    /// When the node may be told again to start.
    pub(super) next_start_ns: u64,
    pub(super) target_lost: bool,
    pub(super) tickets: [Option<SendTicket>; TICKETS],
    pub(super) next_ticket: usize,
    pub(super) decision: Decision,
    pub(super) statistics: AxisStatistics,
    pub(super) trouble: Option<AxisError>,
    pub(super) phase: AxisPhase,
    pub(super) phase_since_ns: u64,
}

impl Axis {
    pub(super) fn new(
        index: usize,
        settings: AxisConfig,
        node: NodeHandle,
        cycles_per_sync: u32,
    ) -> Self {
        let id = settings.address.node;
        let mode = settings.mode;
        Self {
            index,
            node,
            rpdo: CobId::rpdo(id, settings.pdo_number).can_id(),
            layout: settings.layout(),
            cycles_per_sync,
            schedule_images: 0,
            guard: MotionGuard::new(settings.guard_limits(mode, cycles_per_sync)),
            power: PowerControl::new(cycles_per_sync),
            mode,
            set_point: SetPoint::default(),
            ramp: Ramp::new(settings.ramp),
            motion: Motion::Free,
            wanted: None,
            setup: Setup::None,
            configurator: Configurator::new(),
            silences: 0,
            procedure: None,
            release: None,
            resumes: false,
            re_enables: false,
            enabling_since_ns: None,
            disabling_since_ns: None,
            arrived: None,
            statusword: None,
            state: None,
            boot_ups: 0,
            sight: Reachability::default(),
            doubt: Reverification::None,
            next_start_ns: 0,
            target_lost: false,
            tickets: [None; TICKETS],
            next_ticket: 0,
            decision: Decision::Closed,
            statistics: AxisStatistics::default(),
            trouble: None,
            phase: AxisPhase::NotConfigured,
            phase_since_ns: 0,
            settings,
        }
    }

    pub(super) fn is_configured(&self) -> bool {
        matches!(self.setup, Setup::Done)
    }

    pub(super) fn is_enabled(&self) -> bool {
        self.state == Some(DriveState::OperationEnabled)
    }

    pub(super) fn has_status(&self, bits: u16) -> bool {
        self.statusword.is_some_and(|status| status.has(bits))
    }

    /// The target that is in force.
    pub(super) fn target(&self) -> Option<i32> {
        match self.guard.state() {
            GuardState::Running { target } => Some(target),
            _ => None,
        }
    }

    /// Whether a halt has come to its end.
    pub(super) fn is_at_rest(&self) -> bool {
        match self.guard.state() {
            GuardState::Running { target } => match target_kind(self.mode) {
                TargetKind::Position => self.ramp.step() == 0,
                TargetKind::Rate => target == 0,
                // The drive makes its own way, and says when it stands.
                TargetKind::Profile => self.has_status(Statusword::TARGET_REACHED),
                TargetKind::None => true,
            },
            _ => true,
        }
    }

    // Commands

    /// Begins the configuration. Allocates.
    pub(super) fn configure(
        &mut self,
        network: &mut Network,
        bus: &BusConfig,
    ) -> Result<(), CommandError> {
        let steps = start_up::steps(&self.settings, bus)
            .map_err(|error| CommandError::Mapping { axis: self.index, error })?;
        self.rest();
        self.power.set_goal(PowerGoal::None);
        self.cancel_procedure(network);
        self.configurator.clear(network);
        self.configurator.add(network, self.node, steps);
        self.take_mode(self.settings.mode);
        self.setup = Setup::Steps;
        self.silences = network.sdo_silences(self.node);
        self.doubt = Reverification::None;
        self.trouble = None;
        // What the drive said until now, it said under another configuration.
        self.statusword = None;
        self.state = None;
        Ok(())
    }

    /// No targets any more, and nothing that must be taken up again.
    pub(super) fn rest(&mut self) {
        self.guard.release();
        self.wanted = None;
        self.ramp.stop();
        self.motion = Motion::Free;
        self.resumes = false;
        self.re_enables = false;
        self.enabling_since_ns = None;
    }

    fn ready_for_commands(&self) -> Result<(), CommandError> {
        if !self.is_configured() {
            return Err(CommandError::NotConfigured { axis: self.index });
        }
        if self.procedure.is_some() {
            return Err(CommandError::Busy { axis: self.index });
        }
        Ok(())
    }

    /// Establishes the actual position, without enabling.
    pub(super) fn read_position(&mut self) -> Result<(), CommandError> {
        self.ready_for_commands()?;
        self.trouble = None;
        self.guard.take_up();
        Ok(())
    }

    pub(super) fn enable(&mut self, now_ns: u64) -> Result<(), CommandError> {
        self.ready_for_commands()?;
        self.begin_enable(now_ns);
        Ok(())
    }

    pub(super) fn begin_enable(&mut self, now_ns: u64) {
        if self.enabling_since_ns.is_some() {
            return;
        }
        self.trouble = None;
        self.resumes = false;
        if self.target().is_none() {
            self.motion = Motion::Free;
            self.wanted = None;
            self.ramp.stop();
        }
        self.guard.take_up();
        self.power.set_goal(PowerGoal::Enabled);
        self.enabling_since_ns = Some(now_ns);
    }

    pub(super) fn disable(&mut self) {
        self.rest();
        self.power.set_goal(PowerGoal::Disabled);
    }

    pub(super) fn quick_stop(&mut self) {
        self.rest();
        self.guard.hold();
        self.power.set_goal(PowerGoal::QuickStopped);
    }

    pub(super) fn halt(&mut self) {
        self.motion = Motion::Halt;
        self.wanted = None;
    }

    pub(super) fn resume(&mut self) {
        self.motion = Motion::Free;
    }

    pub(super) fn reset_fault(&mut self) -> Result<(), CommandError> {
        self.ready_for_commands()?;
        self.rest();
        self.trouble = None;
        self.power.reset_fault();
        Ok(())
    }

    pub(super) fn change_mode(
        &mut self,
        mode: OperatingMode,
        now_ns: u64,
    ) -> Result<(), CommandError> {
        self.ready_for_commands()?;
        if mode == OperatingMode::Homing || !start_up::can_switch_to(&self.settings, mode) {
            return Err(CommandError::ModeNotMapped { axis: self.index, mode });
        }
        self.begin_procedure(mode, None, now_ns);
        Ok(())
    }

    pub(super) fn home(&mut self, homing: HomingConfig, now_ns: u64) -> Result<(), CommandError> {
        self.ready_for_commands()?;
        self.begin_procedure(self.mode, Some(homing), now_ns);
        Ok(())
    }

    fn begin_procedure(&mut self, mode: OperatingMode, homing: Option<HomingConfig>, now_ns: u64) {
        let then_enable = self.target().is_some();
        self.trouble = None;
        self.motion = Motion::Halt;
        self.wanted = None;
        self.procedure = Some(Procedure::new((self.mode, mode), homing, then_enable, now_ns));
    }

    pub(super) fn cancel_procedure(&mut self, network: &mut Network) {
        if let Some(mut procedure) = self.procedure.take()
            && let Stage::Writing(script) | Stage::Restoring(script) = &mut procedure.stage
        {
            script.cancel(network, self.node);
        }
    }

    /// The drive has confirmed a mode, or is about to.
    pub(super) fn take_mode(&mut self, mode: OperatingMode) {
        self.mode = mode;
        let mut limits = self.settings.guard_limits(mode, self.cycles_per_sync);
        limits.drain_images = limits.drain_images.saturating_add(self.schedule_images);
        self.guard.set_limits(limits);
    }

    // What it is doing

    pub(super) fn note_phase(&mut self, now_ns: u64) {
        let phase = self.present_phase();
        if phase != self.phase {
            self.phase = phase;
            self.phase_since_ns = now_ns;
        }
    }

    fn present_phase(&self) -> AxisPhase {
        match self.setup {
            Setup::None => return AxisPhase::NotConfigured,
            Setup::Steps => return AxisPhase::Configuring,
            Setup::Mode(_) => return AxisPhase::SettingMode(self.mode),
            Setup::Failed(_) => return AxisPhase::SetupFailed,
            Setup::Done => {}
        }
        if let Some(procedure) = &self.procedure {
            return match (procedure.homing, procedure.stage) {
                (None, _) => AxisPhase::ChangingMode(procedure.mode),
                (Some(_), Stage::Homing(_)) => AxisPhase::Homing(self.homing_state()),
                (Some(_), _) => AxisPhase::PreparingHoming,
            };
        }
        if matches!(self.power.reset_state(), ResetState::Low | ResetState::High) {
            return AxisPhase::ResettingFault;
        }
        if self.state == Some(DriveState::Fault) {
            return AxisPhase::Fault;
        }
        match (self.power.goal(), self.guard.state()) {
            (PowerGoal::QuickStopped, _) => AxisPhase::QuickStop,
            (PowerGoal::Disabled, _) if self.re_enables => AxisPhase::Enabling(self.state),
            (PowerGoal::Disabled, _) if !self.is_switched_off() => AxisPhase::Disabling,
            (_, GuardState::Holding { reason }) => AxisPhase::Holding(reason),
            (_, guard @ (GuardState::Draining | GuardState::Reading)) => {
                AxisPhase::Reading(guard, self.guard.hindrance())
            }
            (_, GuardState::Running { .. }) if self.motion == Motion::Halt => AxisPhase::Halted,
            (_, GuardState::Running { .. }) => AxisPhase::Running,
            (PowerGoal::Enabled, GuardState::Armed { .. }) => AxisPhase::Enabling(self.state),
            (_, GuardState::Armed { .. }) => AxisPhase::Ready,
            (_, GuardState::Idle) => AxisPhase::Standby,
        }
    }

    pub(super) fn homing_state(&self) -> HomingState {
        self.statusword.map_or(HomingState::Waiting, HomingState::of)
    }

    pub(super) fn is_switched_off(&self) -> bool {
        self.state.is_some_and(|state| self.power.is_reached(state))
    }

    pub(super) fn progress(&self, now_ns: u64) -> AxisProgress {
        AxisProgress {
            axis: self.index,
            address: self.settings.address,
            phase: self.phase,
            for_ms: now_ns.saturating_sub(self.phase_since_ns) / 1_000_000,
            setup: match self.setup {
                Setup::Steps => self.configurator.progress_of(self.node, now_ns),
                _ => None,
            },
            trouble: self.trouble,
        }
    }
}
