//! State machine of the power stage (CiA 402-2, 8.4).

use ecan_canopen::{
    Command, Controlword, DriveState, FaultReaction, HaltOption, QuickStopOption, StopOption,
};

use super::parameters::Parameters;

/// Deceleration of a stop: of the profile, of a quick stop, or the maximum.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum StopMode {
    Profile,
    Quick,
    Limit,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Action {
    None,
    /// Operation enabled begins at the present motor position.
    Enable,
    /// Switch the current off.
    Release,
    /// Stop; the state machine waits for the standstill.
    Stop(StopMode),
    Reset,
}

/// Conditions of the state machine besides the controlword.
#[derive(Clone, Copy, Debug)]
pub(super) struct Conditions {
    /// A mode is selected, or none is needed.
    pub(super) may_enable: bool,
    pub(super) may_reset: bool,
    pub(super) may_quick_stop: bool,
    /// Duration of enabling, ns.
    pub(super) enable_ns: u64,
}

#[derive(Clone, Debug)]
pub(super) struct PowerStage {
    pub(super) state: DriveState,
    pub(super) controlword: Controlword,
    /// State to enter at standstill.
    next_state: Option<DriveState>,
    /// Time at which Operation enabled begins.
    pub(super) enabled_at: Option<u64>,
}

impl PowerStage {
    pub(super) const fn new() -> Self {
        Self {
            state: DriveState::NotReadyToSwitchOn,
            controlword: Controlword(0),
            next_state: None,
            enabled_at: None,
        }
    }

    pub(super) const fn is_energised(&self) -> bool {
        matches!(
            self.state,
            DriveState::OperationEnabled
                | DriveState::QuickStopActive
                | DriveState::FaultReactionActive
        )
    }

    pub(super) const fn is_faulted(&self) -> bool {
        matches!(self.state, DriveState::Fault | DriveState::FaultReactionActive)
    }

    /// Returns whether a stop is in progress after which the state changes.
    pub(super) const fn has_next_state(&self) -> bool {
        self.next_state.is_some()
    }

    pub(super) fn finish_self_test(&mut self) {
        if self.state == DriveState::NotReadyToSwitchOn {
            self.state = DriveState::SwitchOnDisabled;
        }
    }

    fn enter(&mut self, state: DriveState) -> Action {
        self.state = state;
        self.next_state = None;
        self.enabled_at = None;
        Action::None
    }

    pub(super) fn command(
        &mut self,
        now: u64,
        word: Controlword,
        parameters: &Parameters,
        conditions: &Conditions,
    ) -> Action {
        let previous = std::mem::replace(&mut self.controlword, word);
        let mut command = word.command(previous);
        if command == Command::FaultReset {
            if self.state == DriveState::Fault {
                if !conditions.may_reset {
                    return Action::None;
                }
                self.enter(DriveState::SwitchOnDisabled);
                return Action::Reset;
            }
            // In other states bit 7 has no meaning and the other bits count.
            command = word.command(word);
        }
        if command == Command::QuickStop && !conditions.may_quick_stop {
            return Action::None;
        }
        match (self.state, command) {
            (DriveState::SwitchOnDisabled | DriveState::SwitchedOn, Command::Shutdown) => {
                self.enter(DriveState::ReadyToSwitchOn)
            }
            (DriveState::ReadyToSwitchOn, Command::SwitchOn) => self.enter(DriveState::SwitchedOn),
            // Transitions 3 and 4 together.
            (DriveState::ReadyToSwitchOn, Command::EnableOperation) => {
                self.enter(DriveState::SwitchedOn);
                self.begin_enabling(now, conditions)
            }
            (
                DriveState::ReadyToSwitchOn | DriveState::SwitchedOn,
                Command::DisableVoltage | Command::QuickStop,
            ) => self.enter(DriveState::SwitchOnDisabled),
            (DriveState::SwitchedOn, Command::EnableOperation) if self.enabled_at.is_none() => {
                self.begin_enabling(now, conditions)
            }
            (DriveState::SwitchedOn, Command::SwitchOn | Command::DisableOperation) => {
                self.enter(DriveState::SwitchedOn)
            }
            (DriveState::OperationEnabled, _) => self.command_enabled(command, parameters),
            (DriveState::QuickStopActive, Command::DisableVoltage) => {
                self.release(DriveState::SwitchOnDisabled)
            }
            // Transition 16, if the quick stop stays in its state.
            (DriveState::QuickStopActive, Command::EnableOperation)
                if self.next_state.is_none() =>
            {
                self.enter(DriveState::OperationEnabled);
                Action::Enable
            }
            _ => Action::None,
        }
    }

    fn command_enabled(&mut self, command: Command, parameters: &Parameters) -> Action {
        match command {
            Command::DisableVoltage => self.release(DriveState::SwitchOnDisabled),
            Command::QuickStop => self.quick_stop(parameters),
            Command::Shutdown => self.leave(parameters.shutdown, DriveState::ReadyToSwitchOn),
            Command::SwitchOn | Command::DisableOperation => {
                self.leave(parameters.disable_operation, DriveState::SwitchedOn)
            }
            // Enabling again cancels a stop that leads to another state.
            Command::EnableOperation if self.next_state.take().is_some() => Action::Enable,
            Command::EnableOperation | Command::FaultReset => Action::None,
        }
    }

    fn begin_enabling(&mut self, now: u64, conditions: &Conditions) -> Action {
        if !conditions.may_enable {
            return Action::None;
        }
        if conditions.enable_ns > 0 {
            self.enabled_at = Some(now.saturating_add(conditions.enable_ns));
            return Action::None;
        }
        self.enter(DriveState::OperationEnabled);
        Action::Enable
    }

    /// Enters Operation enabled if the brake is open.
    pub(super) fn finish_enabling(&mut self, now: u64) -> Action {
        if self.enabled_at.is_some_and(|at| at <= now) {
            self.enter(DriveState::OperationEnabled);
            return Action::Enable;
        }
        Action::None
    }

    pub(super) fn release(&mut self, state: DriveState) -> Action {
        self.enter(state);
        Action::Release
    }

    fn leave(&mut self, option: StopOption, state: DriveState) -> Action {
        match option {
            StopOption::SlowDown if self.next_state == Some(state) => Action::None,
            StopOption::SlowDown => {
                self.next_state = Some(state);
                Action::Stop(StopMode::Profile)
            }
            StopOption::Disable | StopOption::Other(_) => self.release(state),
        }
    }

    /// Starts a quick stop, commanded or because the host was lost.
    pub(super) fn quick_stop(&mut self, parameters: &Parameters) -> Action {
        let mode = match parameters.quick_stop {
            QuickStopOption::Disable | QuickStopOption::Other(_) => {
                return self.release(DriveState::SwitchOnDisabled);
            }
            QuickStopOption::SlowDown | QuickStopOption::SlowDownAndStay => StopMode::Profile,
            QuickStopOption::QuickStop | QuickStopOption::QuickStopAndStay => StopMode::Quick,
            _ => StopMode::Limit,
        };
        let leaves = matches!(
            parameters.quick_stop,
            QuickStopOption::SlowDown
                | QuickStopOption::QuickStop
                | QuickStopOption::CurrentLimit
                | QuickStopOption::VoltageLimit
        );
        self.enter(DriveState::QuickStopActive);
        self.next_state = leaves.then_some(DriveState::SwitchOnDisabled);
        Action::Stop(mode)
    }

    pub(super) fn fault(&mut self, parameters: &Parameters) -> Action {
        if self.is_faulted() {
            return Action::None;
        }
        let mode = match parameters.fault_reaction {
            FaultReaction::SlowDown => StopMode::Profile,
            FaultReaction::QuickStop => StopMode::Quick,
            FaultReaction::CurrentLimit | FaultReaction::VoltageLimit => StopMode::Limit,
            FaultReaction::Disable | FaultReaction::Other(_) => {
                return self.release(DriveState::Fault);
            }
        };
        if !self.is_energised() {
            return self.release(DriveState::Fault);
        }
        self.enter(DriveState::FaultReactionActive);
        self.next_state = Some(DriveState::Fault);
        Action::Stop(mode)
    }

    pub(super) fn finish_stop(&mut self) -> Action {
        match self.next_state.take() {
            Some(state) => self.release(state),
            None => Action::None,
        }
    }
}

pub(super) const fn halt_stop_mode(option: HaltOption) -> StopMode {
    match option {
        HaltOption::SlowDown | HaltOption::Other(_) => StopMode::Profile,
        HaltOption::QuickStop => StopMode::Quick,
        HaltOption::CurrentLimit | HaltOption::VoltageLimit => StopMode::Limit,
    }
}
