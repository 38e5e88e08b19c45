//! State machine of the power stage (CiA 402-2, 8.4).

use ecan_canopen::{
    Command, Controlword, DriveState, FaultReaction, HaltOption, QuickStopOption, StopOption,
};

use super::parameters::Parameters;

/// Deceleration of a stop.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum StopMode {
    /// Profile deceleration.
    Profile,
    /// Quick stop deceleration.
    Quick,
    /// Maximum deceleration.
    Limit,
}

/// Action that the state machine demands from the motor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Action {
    None,
    /// Operation enabled begins at the present motor position.
    Enable,
    /// Switch the current off.
    Release,
    /// Stop; the state machine waits for the standstill.
    Stop(StopMode),
    /// A fault was reset.
    Reset,
}

/// Conditions of the state machine besides the controlword.
#[derive(Clone, Copy, Debug)]
pub(super) struct Conditions {
    /// A mode is selected, or none is needed.
    pub(super) may_enable: bool,
    /// Faults can be reset.
    pub(super) may_reset: bool,
    /// Duration of enabling, ns.
    pub(super) enable_ns: u64,
}

#[derive(Clone, Debug)]
pub(super) struct PowerStage {
    state: DriveState,
    word: Controlword,
    /// State to enter at standstill.
    next_state: Option<DriveState>,
    /// Time at which Operation enabled begins.
    enabled_at: Option<u64>,
}

impl PowerStage {
    pub(super) const fn new() -> Self {
        Self {
            state: DriveState::NotReadyToSwitchOn,
            word: Controlword(0),
            next_state: None,
            enabled_at: None,
        }
    }

    pub(super) const fn state(&self) -> DriveState {
        self.state
    }

    pub(super) const fn controlword(&self) -> Controlword {
        self.word
    }

    /// Returns whether the motor is energised.
    pub(super) const fn is_energised(&self) -> bool {
        matches!(
            self.state,
            DriveState::OperationEnabled
                | DriveState::QuickStopActive
                | DriveState::FaultReactionActive
        )
    }

    /// Returns whether a stop is in progress next_state which the state changes.
    pub(super) const fn has_next_state(&self) -> bool {
        self.next_state.is_some()
    }

    pub(super) const fn enabled_at(&self) -> Option<u64> {
        self.enabled_at
    }

    /// Ends the self-test.
    pub(super) fn finish_self_test(&mut self) {
        if self.state == DriveState::NotReadyToSwitchOn {
            self.state = DriveState::SwitchOnDisabled;
        }
    }

    fn enter(&mut self, state: DriveState) {
        self.state = state;
        self.next_state = None;
        self.enabled_at = None;
    }

    /// Executes a controlword.
    pub(super) fn command(
        &mut self,
        now: u64,
        word: Controlword,
        parameters: &Parameters,
        conditions: &Conditions,
    ) -> Action {
        let previous = std::mem::replace(&mut self.word, word);
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
        match self.state {
            DriveState::NotReadyToSwitchOn
            | DriveState::FaultReactionActive
            | DriveState::Fault => Action::None,
            DriveState::SwitchOnDisabled => {
                if command == Command::Shutdown {
                    self.enter(DriveState::ReadyToSwitchOn);
                }
                Action::None
            }
            DriveState::ReadyToSwitchOn => match command {
                Command::SwitchOn => {
                    self.enter(DriveState::SwitchedOn);
                    Action::None
                }
                // Transitions 3 and 4 together.
                Command::EnableOperation => {
                    self.enter(DriveState::SwitchedOn);
                    self.begin_enabling(now, conditions)
                }
                Command::DisableVoltage | Command::QuickStop => {
                    self.enter(DriveState::SwitchOnDisabled);
                    Action::None
                }
                _ => Action::None,
            },
            DriveState::SwitchedOn => match command {
                Command::EnableOperation if self.enabled_at.is_none() => {
                    self.begin_enabling(now, conditions)
                }
                Command::SwitchOn | Command::DisableOperation => {
                    self.enabled_at = None;
                    Action::None
                }
                Command::Shutdown => {
                    self.enter(DriveState::ReadyToSwitchOn);
                    Action::None
                }
                Command::DisableVoltage | Command::QuickStop => {
                    self.enter(DriveState::SwitchOnDisabled);
                    Action::None
                }
                _ => Action::None,
            },
            DriveState::OperationEnabled => self.command_enabled(command, parameters),
            DriveState::QuickStopActive => match command {
                Command::DisableVoltage => self.release(DriveState::SwitchOnDisabled),
                // Transition 16, if the quick stop stays in its state.
                Command::EnableOperation if self.next_state.is_none() => {
                    self.enter(DriveState::OperationEnabled);
                    Action::Enable
                }
                _ => Action::None,
            },
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

    /// Switches the current off.
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
        let (mode, stays) = match parameters.quick_stop {
            QuickStopOption::Disable | QuickStopOption::Other(_) => {
                return self.release(DriveState::SwitchOnDisabled);
            }
            QuickStopOption::SlowDown => (StopMode::Profile, false),
            QuickStopOption::QuickStop => (StopMode::Quick, false),
            QuickStopOption::CurrentLimit | QuickStopOption::VoltageLimit => {
                (StopMode::Limit, false)
            }
            QuickStopOption::SlowDownAndStay => (StopMode::Profile, true),
            QuickStopOption::QuickStopAndStay => (StopMode::Quick, true),
            QuickStopOption::CurrentLimitAndStay | QuickStopOption::VoltageLimitAndStay => {
                (StopMode::Limit, true)
            }
        };
        self.enter(DriveState::QuickStopActive);
        self.next_state = (!stays).then_some(DriveState::SwitchOnDisabled);
        Action::Stop(mode)
    }

    pub(super) fn fault(&mut self, parameters: &Parameters) -> Action {
        match self.state {
            DriveState::FaultReactionActive | DriveState::Fault => Action::None,
            _ if !self.is_energised() => self.release(DriveState::Fault),
            _ => {
                let mode = match parameters.fault_reaction {
                    FaultReaction::Disable | FaultReaction::Other(_) => {
                        return self.release(DriveState::Fault);
                    }
                    FaultReaction::SlowDown => StopMode::Profile,
                    FaultReaction::QuickStop => StopMode::Quick,
                    FaultReaction::CurrentLimit | FaultReaction::VoltageLimit => StopMode::Limit,
                };
                self.enter(DriveState::FaultReactionActive);
                self.next_state = Some(DriveState::Fault);
                Action::Stop(mode)
            }
        }
    }

    /// Enters the state that follows a stop, at standstill.
    pub(super) fn finish_stop(&mut self) -> Action {
        match self.next_state.take() {
            Some(state) => self.release(state),
            None => Action::None,
        }
    }
}

/// Deceleration of a halt.
pub(super) const fn halt_stop_mode(option: HaltOption) -> StopMode {
    match option {
        HaltOption::SlowDown | HaltOption::Other(_) => StopMode::Profile,
        HaltOption::QuickStop => StopMode::Quick,
        HaltOption::CurrentLimit | HaltOption::VoltageLimit => StopMode::Limit,
    }
}
