//! Commands that an axis gives itself over several cycles: mode change, homing, recovery.

use std::time::Duration;

use ecan_canopen::{Configuring, DriveState, Network, OperatingMode, Statusword, Step, object};

use super::drive_status::DriveStatus;
use super::plan::{AxisEvent, AxisPlan};
use super::script::{Script, axis_script, mode_steps};
use super::setup::SetupState;
use super::status::{AxisError, HomingState};
use crate::guard::terms::HoldReason;

/// Longest time in which an axis must come to rest, and its drive switch off.
const REST_TIMEOUT: Duration = Duration::from_secs(30);

/// Stages of a mode change and of homing, in order. The mode is only changed while the drive is
/// not enabled: an enabled drive would go from the target of one mode to an old one of the other.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Stage {
    /// The axis comes to rest and is switched off.
    Disabling,
    /// Parameters and mode are written.
    Writing(Script),
    /// Homing: the drive is enabled.
    Enabling,
    /// Homing: the start bit is set.
    Homing(HomingWatch),
    /// Homing: the drive is switched off, so that the mode can change back.
    Ending,
    /// Homing: the previous mode is written.
    Restoring(Script),
}

/// A mode change, or a homing that returns to the mode before it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Procedure {
    /// Mode in force at the end.
    mode: OperatingMode,
    mode_before: OperatingMode,
    homing: Option<HomingConfig>,
    /// True if the axis followed targets before and is enabled again afterwards.
    then_enable: bool,
    stage: Stage,
    error: Option<AxisError>,
    stage_since_ns: u64,
}

/// Situation of an axis in a cycle of a procedure.
#[derive(Debug)]
pub(crate) struct ProcedureSituation<'a> {
    pub(crate) plan: &'a AxisPlan,
    pub(crate) drive: &'a DriveStatus,
    pub(crate) is_running: bool,
    pub(crate) is_at_rest: bool,
    pub(crate) is_enabling: bool,
    pub(crate) is_stopping: bool,
    pub(crate) is_stopped: bool,
    /// The drive may be moving and has no present status.
    pub(crate) is_silent: bool,
    pub(crate) error: Option<AxisError>,
    pub(crate) now_ns: u64,
}

/// Result of a cycle of a procedure: the event is applied first.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct ProcedureStep {
    pub(crate) event: Option<AxisEvent>,
    pub(crate) has_ended: bool,
}

impl ProcedureStep {
    const CONTINUE: Self = Self { event: None, has_ended: false };
    const END: Self = Self { event: None, has_ended: true };

    fn event(event: AxisEvent) -> Self {
        Self { event: Some(event), has_ended: false }
    }

    fn last_event(event: AxisEvent) -> Self {
        Self { event: Some(event), has_ended: true }
    }
}

impl Procedure {
    /// Creates a mode change from `mode_before` to `mode`.
    pub(crate) fn change_mode(mode_before: OperatingMode, mode: OperatingMode) -> Self {
        Self {
            mode,
            mode_before,
            homing: None,
            then_enable: false,
            stage: Stage::Disabling,
            error: None,
            stage_since_ns: 0,
        }
    }

    /// Creates a homing that returns to `mode`.
    pub(crate) fn home(mode: OperatingMode, homing: HomingConfig) -> Self {
        Self { homing: Some(homing), ..Self::change_mode(mode, mode) }
    }

    /// Begins. `then_enable` states whether the axis is enabled at the end.
    pub(crate) fn begin(mut self, then_enable: bool, now_ns: u64) -> Self {
        self.then_enable = then_enable;
        self.stage_since_ns = now_ns;
        self
    }

    /// Mode in force at the end.
    pub(crate) fn mode(&self) -> OperatingMode {
        self.mode
    }

    pub(crate) fn is_homing(&self) -> bool {
        self.homing.is_some()
    }

    /// Returns whether the drive is to execute the homing.
    pub(crate) fn has_started_homing(&self) -> bool {
        matches!(self.stage, Stage::Homing(_))
    }

    pub(crate) fn error(&self) -> Option<AxisError> {
        self.error
    }

    /// Returns whether the axis is enabled after a procedure without an error.
    pub(crate) fn enables_at_end(&self) -> bool {
        self.then_enable
    }

    /// Cancels the transfers. Returns the mode that is to be written again, if the procedure has begun to
    /// write one.
    pub(crate) fn cancel(&self, plan: &AxisPlan, network: &mut Network) -> Option<OperatingMode> {
        if let Stage::Writing(script) | Stage::Restoring(script) = self.stage {
            script.cancel(network, plan.node);
        }
        (self.stage != Stage::Disabling).then_some(self.mode_before)
    }

    /// Notes a hold. Before the drive is off, this ends the procedure: later it could enable a drive
    /// that stopped without a command.
    pub(crate) fn on_hold(&mut self, reason: HoldReason) {
        if self.stage == Stage::Disabling {
            self.error = Some(AxisError::Held(reason));
        }
    }

    fn enter(&mut self, stage: Stage, now_ns: u64) {
        self.stage = stage;
        self.stage_since_ns = now_ns;
    }

    fn waited(&self, now_ns: u64) -> Duration {
        Duration::from_nanos(now_ns.saturating_sub(self.stage_since_ns))
    }

    fn restore(&mut self, plan: &AxisPlan, now_ns: u64) {
        let script = axis_script(plan.config.node_axis, mode_steps(self.mode_before));
        self.enter(Stage::Restoring(script), now_ns);
    }

    /// Continues the procedure in a cycle.
    pub(crate) fn step(
        &mut self,
        situation: &ProcedureSituation<'_>,
        network: &mut Network,
    ) -> ProcedureStep {
        match self.stage {
            Stage::Disabling => self.step_disabling(situation),
            Stage::Writing(_) => self.step_writing(situation, network),
            Stage::Enabling => self.step_enabling(situation),
            Stage::Homing(_) => self.step_homing(situation),
            Stage::Ending => self.step_ending(situation),
            Stage::Restoring(_) => self.step_restoring(situation, network),
        }
    }

    /// Brings the axis to rest by the ramp, then switches power off. A hold, or a drive that is out of
    /// reach, ends the procedure.
    fn step_disabling(&mut self, situation: &ProcedureSituation<'_>) -> ProcedureStep {
        let ProcedureSituation { plan, drive, now_ns, .. } = *situation;
        if situation.is_stopping && situation.is_silent {
            let not_disabled = AxisError::NotDisabled { state: drive.state };
            self.error = self.error.or(Some(not_disabled));
        }
        if self.error.is_some() {
            return ProcedureStep::END;
        }
        let is_moving = situation.is_running && !situation.is_at_rest;
        let is_late = self.waited(now_ns) > REST_TIMEOUT;
        if is_moving && !is_late {
            return ProcedureStep::CONTINUE;
        }
        match drive.state {
            Some(DriveState::Fault) => {
                self.error = Some(AxisError::Fault { error_code: 0 });
                ProcedureStep::END
            }
            Some(DriveState::SwitchOnDisabled) if situation.is_stopped => {
                let axis = plan.config.node_axis;
                let script = match &self.homing {
                    Some(homing) => homing.script(axis),
                    None => axis_script(axis, mode_steps(self.mode)),
                };
                self.enter(Stage::Writing(script), now_ns);
                ProcedureStep::CONTINUE
            }
            state if is_late => {
                self.error = Some(AxisError::NotDisabled { state });
                ProcedureStep::END
            }
            _ => ProcedureStep::event(AxisEvent::SwitchOff),
        }
    }

    fn step_writing(
        &mut self,
        situation: &ProcedureSituation<'_>,
        network: &mut Network,
    ) -> ProcedureStep {
        let ProcedureSituation { plan, now_ns, .. } = *situation;
        let Stage::Writing(script) = &mut self.stage else { return ProcedureStep::END };
        match script.advance(network, plan.node, now_ns, |_, _, _| {}) {
            Configuring::Running => ProcedureStep::CONTINUE,
            Configuring::Done if self.homing.is_some() => {
                self.enter(Stage::Enabling, now_ns);
                ProcedureStep::event(AxisEvent::HomingSet)
            }
            Configuring::Done => ProcedureStep::last_event(AxisEvent::ModeSet(self.mode)),
            Configuring::Failed(failure) => {
                self.error = Some(AxisError::Mode(failure));
                self.restore(plan, now_ns);
                ProcedureStep::CONTINUE
            }
        }
    }

    fn step_enabling(&mut self, situation: &ProcedureSituation<'_>) -> ProcedureStep {
        if situation.is_running {
            self.enter(Stage::Homing(HomingWatch::default()), situation.now_ns);
        } else if !situation.is_enabling {
            // Timeout, hold or fault; the error is set.
            self.error = situation.error;
            self.enter(Stage::Ending, situation.now_ns);
        }
        ProcedureStep::CONTINUE
    }

    fn step_homing(&mut self, situation: &ProcedureSituation<'_>) -> ProcedureStep {
        let ProcedureSituation { drive, now_ns, .. } = *situation;
        let waited = self.waited(now_ns);
        let Stage::Homing(watch) = &mut self.stage else { return ProcedureStep::END };
        let result = drive.arrived.and_then(|feedback| watch.step(feedback.statusword));
        let limit = self.homing.map_or(Duration::ZERO, |homing| homing.timeout);
        self.error = if !situation.is_running {
            situation.error.or(Some(AxisError::Homing(HomingState::Waiting)))
        } else {
            match result {
                Some(HomingState::Attained) => None,
                Some(state) => Some(AxisError::Homing(state)),
                None if waited > limit => {
                    let state = drive.homing_state();
                    Some(AxisError::HomingTimedOut { state, waited })
                }
                None => return ProcedureStep::CONTINUE,
            }
        };
        self.enter(Stage::Ending, now_ns);
        ProcedureStep::CONTINUE
    }

    /// Switches power off after homing, with any result; a drive that is still homing stops with
    /// it.
    fn step_ending(&mut self, situation: &ProcedureSituation<'_>) -> ProcedureStep {
        let ProcedureSituation { plan, drive, now_ns, .. } = *situation;
        let is_off = situation.is_stopped && drive.is_off();
        let is_late = self.waited(now_ns) > REST_TIMEOUT;
        // The axis is stopped by the event in any case.
        if !is_off && (is_late || situation.is_silent) {
            let not_disabled = AxisError::NotDisabled { state: drive.state };
            self.error = self.error.or(Some(not_disabled));
        }
        if is_off || is_late {
            self.restore(plan, now_ns);
        }
        let event = (!is_off).then_some(AxisEvent::SwitchOff);
        ProcedureStep { event, has_ended: false }
    }

    fn step_restoring(
        &mut self,
        situation: &ProcedureSituation<'_>,
        network: &mut Network,
    ) -> ProcedureStep {
        let ProcedureSituation { plan, now_ns, .. } = *situation;
        let Stage::Restoring(script) = &mut self.stage else { return ProcedureStep::END };
        match script.advance(network, plan.node, now_ns, |_, _, _| {}) {
            Configuring::Running => ProcedureStep::CONTINUE,
            Configuring::Done => ProcedureStep::last_event(AxisEvent::ModeSet(self.mode_before)),
            Configuring::Failed(failure) => {
                // The drive's mode is unknown: it must be configured again.
                self.error = self.error.or(Some(AxisError::Mode(failure)));
                ProcedureStep::last_event(AxisEvent::SetupFailed(failure))
            }
        }
    }
}

/// Most attempts to enable: a hold on the path may occur again while the bus comes back.
const ENABLE_ATTEMPTS: u8 = 3;

/// Most configurations: the drive may restart while it is configured.
const CONFIGURE_ATTEMPTS: u8 = 2;

/// A recovery in progress. It issues the commands that an application would, each when the one before
/// is complete.
///
/// | the axis | step |
/// | --- | --- |
/// | is being stopped, configured, reset or enabled | wait |
/// | is not configured | configure; not more than twice |
/// | has a fault | reset; a fault after that ends the recovery |
/// | holds, has stopped, or has no command | enable; not more than three times, and not after a timeout |
/// | is halted | resume |
/// | follows targets | the recovery is complete |
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) struct Recovery {
    configured: u8,
    enabled: u8,
    is_reset: bool,
}

/// Situation of an axis in a cycle of its recovery.
#[derive(Debug)]
pub(crate) struct RecoverySituation<'a> {
    pub(crate) setup: &'a SetupState,
    pub(crate) error: Option<AxisError>,
    pub(crate) is_in_fault: bool,
    pub(crate) is_resetting: bool,
    /// The axis has no command, or has stopped.
    pub(crate) may_enable: bool,
    /// The drive is enabled and the guard follows targets.
    pub(crate) is_active: bool,
}

/// Step of a recovery.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum RecoveryStep {
    Wait,
    Command(AxisEvent),
    /// The recovery ends with a command, or without one.
    End(Option<AxisEvent>),
}

impl Recovery {
    pub(crate) fn step(&mut self, situation: &RecoverySituation<'_>) -> RecoveryStep {
        match situation.setup {
            SetupState::Requested { .. } | SetupState::Configuring | SetupState::SettingMode(_) => {
                RecoveryStep::Wait
            }
            SetupState::Unconfigured | SetupState::Failed => self.configure(situation),
            SetupState::Complete if situation.is_in_fault => self.reset(situation),
            SetupState::Complete if situation.may_enable => self.enable(situation),
            SetupState::Complete if situation.is_active => {
                RecoveryStep::End(Some(AxisEvent::Resume))
            }
            SetupState::Complete => RecoveryStep::Wait,
        }
    }

    fn configure(&mut self, situation: &RecoverySituation<'_>) -> RecoveryStep {
        // A drive that does not answer and may be moving is not configured.
        let is_rejected = matches!(situation.error, Some(AxisError::NotStopped { .. }));
        if self.configured >= CONFIGURE_ATTEMPTS || self.configured > 0 && is_rejected {
            return RecoveryStep::End(None);
        }
        self.configured += 1;
        RecoveryStep::Command(AxisEvent::Configure)
    }

    fn reset(&mut self, situation: &RecoverySituation<'_>) -> RecoveryStep {
        if situation.is_resetting {
            return RecoveryStep::Wait;
        }
        if self.is_reset {
            return RecoveryStep::End(None);
        }
        self.is_reset = true;
        RecoveryStep::Command(AxisEvent::ResetFault)
    }

    fn enable(&mut self, situation: &RecoverySituation<'_>) -> RecoveryStep {
        let has_timed_out = matches!(situation.error, Some(AxisError::EnableTimedOut { .. }));
        if self.enabled >= ENABLE_ATTEMPTS || self.enabled > 0 && has_timed_out {
            return RecoveryStep::End(None);
        }
        self.enabled += 1;
        RecoveryStep::Command(AxisEvent::Enable)
    }
}

/// Cycles for which a drive may still show the result of an earlier homing after the start.
const OLD_RESULT_CYCLES: u16 = 20;

/// Homing of an axis. Objects that a drive does not have are skipped, apart from
/// the method.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct HomingConfig {
    /// Homing method, 0x6098: 35 and 37 take the present position as home, -4..-1 are
    /// manufacturers', 1..34 look for switches and index pulses.
    pub method: i8,
    /// Speed on the way to the switch, 0x6099:01, in the drive's units; `None` leaves it alone.
    pub switch_speed: Option<u32>,
    /// Speed on the way to the zero, 0x6099:02; `None` leaves it alone.
    pub zero_speed: Option<u32>,
    /// Acceleration, 0x609A; `None` leaves it alone.
    pub acceleration: Option<u32>,
    /// Position that the home position gets, 0x607C; `None` leaves it alone.
    pub offset: Option<i32>,
    /// Longest time for the movement.
    pub timeout: Duration,
}

impl HomingConfig {
    /// A method with the drive's own speeds, and a minute for it.
    pub fn new(method: i8) -> Self {
        Self {
            method,
            switch_speed: None,
            zero_speed: None,
            acceleration: None,
            offset: None,
            timeout: Duration::from_secs(60),
        }
    }

    /// Writes the parameters, then the mode.
    pub(crate) fn script(&self, axis: u8) -> Script {
        let optional = [
            self.switch_speed.map(|speed| Step::write(object::HOMING_SPEEDS, 1, speed)),
            self.zero_speed.map(|speed| Step::write(object::HOMING_SPEEDS, 2, speed)),
            self.acceleration.map(|value| Step::write(object::HOMING_ACCELERATION, 0, value)),
            self.offset.map(|offset| Step::write(object::HOME_OFFSET, 0, offset)),
        ];
        let method = Step::write(object::HOMING_METHOD, 0, self.method).named("homing method");
        let optional = optional.into_iter().flatten().map(Step::if_present);
        let steps = [method].into_iter().chain(optional).chain(mode_steps(OperatingMode::Homing));
        axis_script(axis, steps)
    }
}

/// Evaluates a homing by the statuswords since its start bit was set.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
struct HomingWatch {
    cycles: u16,
    /// The drive has shown that its report is about this homing, not about an earlier one.
    has_begun: bool,
}

impl HomingWatch {
    /// Evaluates a cycle with the start bit on the bus. Returns `None` until the homing has a result.
    fn step(&mut self, status: Statusword) -> Option<HomingState> {
        let state = HomingState::of(status);
        self.cycles = self.cycles.saturating_add(1);
        match state {
            HomingState::Running | HomingState::Found | HomingState::Failing => {
                self.has_begun = true;
                None
            }
            // Methods 35 and 37 end within a cycle.
            HomingState::Attained | HomingState::Failed
                if self.has_begun || self.cycles > OLD_RESULT_CYCLES =>
            {
                Some(state)
            }
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ATTAINED: Statusword = Statusword(0x1637);
    const RUNNING: Statusword = Statusword(0x0237);
    const FAILED: Statusword = Statusword(0x2637);

    #[test]
    fn homing_state_follows_the_statusword_bits() {
        let states = [
            (0x0237, HomingState::Running),
            (0x0637, HomingState::Waiting),
            (0x1237, HomingState::Found),
            (0x1637, HomingState::Attained),
            (0x2237, HomingState::Failing),
            (0x2637, HomingState::Failed),
        ];
        for (word, state) in states {
            assert_eq!(HomingState::of(Statusword(word)), state);
        }
    }

    #[test]
    fn result_of_an_earlier_homing_is_ignored() {
        let mut watch = HomingWatch::default();
        assert_eq!(watch.step(ATTAINED), None, "from before");
        assert_eq!(watch.step(RUNNING), None);
        assert_eq!(watch.step(ATTAINED), Some(HomingState::Attained));
        let mut watch = HomingWatch::default();
        watch.step(RUNNING);
        assert_eq!(watch.step(FAILED), Some(HomingState::Failed));
    }

    #[test]
    fn immediate_homing_is_detected() {
        let mut watch = HomingWatch::default();
        let done = (0..30).find_map(|_| watch.step(ATTAINED));
        assert_eq!(done, Some(HomingState::Attained));
    }
}
