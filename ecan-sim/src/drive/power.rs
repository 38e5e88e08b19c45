//! The state machine of the power stage (CiA 402-2, 8.4).

use ecan_canopen::{
    Command, Controlword, DriveState, FaultReaction, HaltOption, QuickStopOption, StopOption,
};

use super::parameters::Parameters;

/// How the motor is brought to rest.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum StopMode {
    /// On the profile deceleration.
    Profile,
    /// On the quick stop deceleration.
    Quick,
    /// As fast as it can.
    Limit,
}

/// What a step of the state machine asks of the motor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Action {
    /// Nothing new.
    None,
    /// Operation Enabled begins: take the motor up where it is.
    TakeUp,
    /// No current any more.
    Free,
    /// Bring it to rest; the state machine waits for that.
    Slow(StopMode),
    /// A fault has been reset.
    Reset,
}

/// What the state machine has to know beside the controlword.
#[derive(Clone, Copy, Debug)]
pub(super) struct Conditions {
    /// A mode is chosen, or none is needed.
    pub(super) may_enable: bool,
    /// Faults can be reset.
    pub(super) may_reset: bool,
    /// Nanoseconds that enabling takes.
    pub(super) enable_ns: u64,
}

/// The state machine.
#[derive(Clone, Debug)]
pub(super) struct PowerStage {
    state: DriveState,
    word: Controlword,
    /// State to be entered once the motor stands.
    after: Option<DriveState>,
    /// When Operation Enabled begins.
    enabled_at: Option<u64>,
}

impl PowerStage {
    pub(super) const fn new() -> Self {
        Self {
            state: DriveState::NotReadyToSwitchOn,
            word: Controlword(0),
            after: None,
            enabled_at: None,
        }
    }

    pub(super) const fn state(&self) -> DriveState {
        self.state
    }

    pub(super) const fn controlword(&self) -> Controlword {
        self.word
    }

    /// Whether the motor has current.
    pub(super) const fn is_energised(&self) -> bool {
        matches!(
            self.state,
            DriveState::OperationEnabled
                | DriveState::QuickStopActive
                | DriveState::FaultReactionActive
        )
    }

    /// Whether a stop is under way that ends in another state.
    pub(super) const fn is_leaving(&self) -> bool {
        self.after.is_some()
    }

    /// When Operation Enabled begins by itself.
    pub(super) const fn enabled_at(&self) -> Option<u64> {
        self.enabled_at
    }

    /// The self-test is over.
    pub(super) fn ready(&mut self) {
        if self.state == DriveState::NotReadyToSwitchOn {
            self.state = DriveState::SwitchOnDisabled;
        }
    }

    fn enter(&mut self, state: DriveState) {
        self.state = state;
        self.after = None;
        self.enabled_at = None;
    }

    /// Takes a controlword.
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
            // Elsewhere bit 7 has no meaning, and the other bits count.
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
                // Transitions 3 and 4 in one go.
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
                // Transition 16, where the quick stop stays in its state.
                Command::EnableOperation if self.after.is_none() => {
                    self.enter(DriveState::OperationEnabled);
                    Action::TakeUp
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
            // Enabling again takes a stop on the way out back.
            Command::EnableOperation if self.after.take().is_some() => Action::TakeUp,
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
        Action::TakeUp
    }

    /// The brake is open: Operation Enabled begins if it is time.
    pub(super) fn brake_opens(&mut self, now: u64) -> Action {
        if self.enabled_at.is_some_and(|at| at <= now) {
            self.enter(DriveState::OperationEnabled);
            return Action::TakeUp;
        }
        Action::None
    }

    /// Cuts the current.
    pub(super) fn release(&mut self, state: DriveState) -> Action {
        self.enter(state);
        Action::Free
    }

    fn leave(&mut self, option: StopOption, state: DriveState) -> Action {
        match option {
            StopOption::SlowDown if self.after == Some(state) => Action::None,
            StopOption::SlowDown => {
                self.after = Some(state);
                Action::Slow(StopMode::Profile)
            }
            StopOption::Disable | StopOption::Other(_) => self.release(state),
        }
    }

    /// Quick stop, by the controlword or because the host is gone.
    pub(super) fn quick_stop(&mut self, parameters: &Parameters) -> Action {
        let (slowing, stays) = match parameters.quick_stop {
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
        self.after = (!stays).then_some(DriveState::SwitchOnDisabled);
        Action::Slow(slowing)
    }

    /// A fault has been found.
    pub(super) fn fault(&mut self, parameters: &Parameters) -> Action {
        match self.state {
            DriveState::FaultReactionActive | DriveState::Fault => Action::None,
            _ if !self.is_energised() => self.release(DriveState::Fault),
            _ => {
                let slowing = match parameters.fault_reaction {
                    FaultReaction::Disable | FaultReaction::Other(_) => {
                        return self.release(DriveState::Fault);
                    }
                    FaultReaction::SlowDown => StopMode::Profile,
                    FaultReaction::QuickStop => StopMode::Quick,
                    FaultReaction::CurrentLimit | FaultReaction::VoltageLimit => StopMode::Limit,
                };
                self.enter(DriveState::FaultReactionActive);
                self.after = Some(DriveState::Fault);
                Action::Slow(slowing)
            }
        }
    }

    /// The motor stands: what was to come then comes.
    pub(super) fn stands(&mut self) -> Action {
        match self.after.take() {
            Some(state) => self.release(state),
            None => Action::None,
        }
    }
}

/// How a halt slows down.
pub(super) const fn halt_slowing(option: HaltOption) -> StopMode {
    match option {
        HaltOption::SlowDown | HaltOption::Other(_) => StopMode::Profile,
        HaltOption::QuickStop => StopMode::Quick,
        HaltOption::CurrentLimit | HaltOption::VoltageLimit => StopMode::Limit,
    }
}
