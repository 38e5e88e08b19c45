//! Which controlword brings a drive where it is to be (CiA 402-2, 8.2).

use std::fmt;

use ecan_canopen::{Command, Controlword, DriveState};

/// Where the power stage of a drive is to be.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum PowerGoal {
    /// Nothing is commanded.
    #[default]
    None,
    /// Operation Enabled.
    Enabled,
    /// Switch On Disabled, step by step: the drive first leaves operation by its own rules (0x605C),
    /// then switches power off.
    Disabled,
    /// Quick stop by the drive's own rules (0x605A), and to stay there.
    QuickStopped,
}

/// How a fault reset stands.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum ResetState {
    /// None was asked for.
    #[default]
    Idle,
    /// The bit is held low, so that the drive sees an edge.
    Low,
    /// The bit is high; the drive is to leave the fault.
    High,
    /// The drive stays in fault: the cause is still there.
    Failed,
}

/// Frames for which a level of the fault reset bit is held, per SYNC period: a drive that takes
/// its RPDO with SYNC sees the last one before each.
const LEVEL_FRAMES: u16 = 3;
/// Frames after which a drive that is still in fault refuses the reset, in levels.
const PATIENCE_LEVELS: u16 = 100;

/// Commands of one drive: the goal, and the edge of a fault reset.
///
/// [`controlword`](Self::controlword) says what to send for the state that the drive reports;
/// [`sent`](Self::sent) that it went out. What was not sent is not counted, so that a level of the
/// reset bit is really on the bus before the next.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PowerControl {
    goal: PowerGoal,
    reset: ResetState,
    level_frames: u16,
    frames: u16,
}

impl PowerControl {
    /// Nothing commanded. `cycles_per_sync` stretches the levels of the reset bit.
    pub fn new(cycles_per_sync: u32) -> Self {
        let cycles = u16::try_from(cycles_per_sync.max(1)).unwrap_or(u16::MAX);
        Self {
            goal: PowerGoal::None,
            reset: ResetState::Idle,
            level_frames: LEVEL_FRAMES.saturating_mul(cycles),
            frames: 0,
        }
    }

    /// The goal.
    pub fn goal(&self) -> PowerGoal {
        self.goal
    }

    /// Sets the goal. It replaces a fault reset under way.
    pub fn set_goal(&mut self, goal: PowerGoal) {
        self.goal = goal;
        self.reset = ResetState::Idle;
    }

    /// Whether there is anything to command.
    pub fn is_commanding(&self) -> bool {
        self.goal != PowerGoal::None || matches!(self.reset, ResetState::Low | ResetState::High)
    }

    /// How the fault reset stands.
    pub fn reset_state(&self) -> ResetState {
        self.reset
    }

    /// Asks for a fault reset. The goal becomes [`PowerGoal::None`]: enabling is another command.
    pub fn reset_fault(&mut self) {
        self.goal = PowerGoal::None;
        self.reset = ResetState::Low;
        self.frames = 0;
    }

    /// What to command in this state; `None` where nothing is to be commanded. Real-time safe.
    ///
    /// | state | Enabled | Disabled | QuickStopped |
    /// | --- | --- | --- | --- |
    /// | Not Ready To Switch On | wait | wait | wait |
    /// | Switch On Disabled | shutdown 0x06 | reached | reached |
    /// | Ready To Switch On | switch on 0x07 | disable voltage 0x00 | reached |
    /// | Switched On | enable operation 0x0F | shutdown 0x06 | reached |
    /// | Operation Enabled | 0x0F | disable operation 0x07 | quick stop 0x02 |
    /// | Quick Stop Active | disable voltage 0x00 | disable voltage 0x00 | quick stop 0x02 |
    /// | Fault Reaction Active | wait | wait | wait |
    /// | Fault | nothing: a reset is a command of its own | reached | reached |
    ///
    /// A fault reset sends 0x00 with the bit low, then 0x80, each for several frames, and ends
    /// when the drive has left the fault.
    pub fn controlword(&mut self, state: DriveState) -> Option<Controlword> {
        match self.reset {
            ResetState::Idle | ResetState::Failed => {}
            ResetState::Low if state == DriveState::Fault => {
                return Some(Controlword::of(Command::DisableVoltage));
            }
            ResetState::High if state == DriveState::Fault => {
                return Some(Controlword::of(Command::FaultReset));
            }
            // The reaction to the fault is still going on.
            _ if state == DriveState::FaultReactionActive => return None,
            _ => self.reset = ResetState::Idle,
        }
        command(self.goal, state).map(Controlword::of)
    }

    /// The controlword went out.
    pub fn sent(&mut self) {
        let limit = match self.reset {
            ResetState::Low => self.level_frames,
            ResetState::High => self.level_frames.saturating_mul(PATIENCE_LEVELS),
            ResetState::Idle | ResetState::Failed => return,
        };
        self.frames = self.frames.saturating_add(1);
        if self.frames >= limit {
            self.frames = 0;
            self.reset = match self.reset {
                ResetState::Low => ResetState::High,
                _ => ResetState::Failed,
            };
        }
    }

    /// Whether the drive is where it is to be.
    pub fn is_reached(&self, state: DriveState) -> bool {
        use DriveState::{
            Fault, OperationEnabled, QuickStopActive, ReadyToSwitchOn, SwitchOnDisabled, SwitchedOn,
        };
        match self.goal {
            PowerGoal::None => true,
            PowerGoal::Enabled => state == OperationEnabled,
            PowerGoal::Disabled => matches!(state, SwitchOnDisabled | Fault),
            PowerGoal::QuickStopped => matches!(
                state,
                QuickStopActive | SwitchOnDisabled | ReadyToSwitchOn | SwitchedOn | Fault
            ),
        }
    }
}

fn command(goal: PowerGoal, state: DriveState) -> Option<Command> {
    use DriveState as S;
    match (goal, state) {
        (PowerGoal::None, _)
        | (_, S::NotReadyToSwitchOn | S::FaultReactionActive | S::Fault)
        | (PowerGoal::Disabled, S::SwitchOnDisabled)
        | (PowerGoal::QuickStopped, S::SwitchOnDisabled | S::ReadyToSwitchOn | S::SwitchedOn) => {
            None
        }
        (PowerGoal::Enabled, S::SwitchOnDisabled) => Some(Command::Shutdown),
        (PowerGoal::Enabled, S::ReadyToSwitchOn) => Some(Command::SwitchOn),
        (PowerGoal::Enabled, S::SwitchedOn | S::OperationEnabled) => Some(Command::EnableOperation),
        (PowerGoal::Enabled | PowerGoal::Disabled, S::QuickStopActive) => {
            Some(Command::DisableVoltage)
        }
        (PowerGoal::Disabled, S::OperationEnabled) => Some(Command::DisableOperation),
        (PowerGoal::Disabled, S::SwitchedOn) => Some(Command::Shutdown),
        (PowerGoal::Disabled, S::ReadyToSwitchOn) => Some(Command::DisableVoltage),
        (PowerGoal::QuickStopped, S::OperationEnabled | S::QuickStopActive) => {
            Some(Command::QuickStop)
        }
    }
}

impl fmt::Display for PowerGoal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::None => "no command",
            Self::Enabled => "enable",
            Self::Disabled => "disable",
            Self::QuickStopped => "quick stop",
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const STATES: [DriveState; 8] = [
        DriveState::NotReadyToSwitchOn,
        DriveState::SwitchOnDisabled,
        DriveState::ReadyToSwitchOn,
        DriveState::SwitchedOn,
        DriveState::OperationEnabled,
        DriveState::QuickStopActive,
        DriveState::FaultReactionActive,
        DriveState::Fault,
    ];

    /// A drive by the transitions of CiA 402-2, figure 6, with quick stop option "stay".
    fn answer(state: DriveState, word: Controlword, before: Controlword) -> DriveState {
        use DriveState as S;
        match (state, word.command(before)) {
            (S::NotReadyToSwitchOn, _) => S::SwitchOnDisabled,
            (S::FaultReactionActive, _) => S::Fault,
            (S::Fault, Command::FaultReset) => S::SwitchOnDisabled,
            (S::Fault, _) => S::Fault,
            (_, Command::DisableVoltage | Command::FaultReset) => S::SwitchOnDisabled,
            (S::SwitchOnDisabled, Command::Shutdown) => S::ReadyToSwitchOn,
            (S::SwitchOnDisabled, _) => S::SwitchOnDisabled,
            (S::OperationEnabled, Command::QuickStop) => S::QuickStopActive,
            (S::QuickStopActive, _) => S::QuickStopActive,
            (_, Command::QuickStop) => S::SwitchOnDisabled,
            (_, Command::Shutdown) => S::ReadyToSwitchOn,
            (S::OperationEnabled, Command::SwitchOn | Command::DisableOperation) => S::SwitchedOn,
            (S::ReadyToSwitchOn, Command::SwitchOn) => S::SwitchedOn,
            (S::SwitchedOn, Command::EnableOperation) => S::OperationEnabled,
            (other, _) => other,
        }
    }

    fn drive_to(goal: PowerGoal, from: DriveState) -> (DriveState, Vec<u16>) {
        let mut control = PowerControl::new(1);
        control.set_goal(goal);
        let (mut state, mut before, mut words) = (from, Controlword(0), Vec::new());
        for _ in 0..20 {
            if let Some(word) = control.controlword(state) {
                state = answer(state, word, before);
                before = word;
                words.push(word.0);
                control.sent();
            } else if matches!(
                state,
                DriveState::NotReadyToSwitchOn | DriveState::FaultReactionActive
            ) {
                state = answer(state, before, before);
            }
            if control.is_reached(state) {
                break;
            }
        }
        (state, words)
    }

    #[test]
    fn every_state_but_fault_leads_to_operation_enabled() {
        for from in STATES {
            let faulty = matches!(from, DriveState::Fault | DriveState::FaultReactionActive);
            let reached = if faulty { DriveState::Fault } else { DriveState::OperationEnabled };
            assert_eq!(drive_to(PowerGoal::Enabled, from).0, reached, "from {from}");
        }
        let words = drive_to(PowerGoal::Enabled, DriveState::SwitchOnDisabled).1;
        assert_eq!(words, [0x06, 0x07, 0x0F]);
        let words = drive_to(PowerGoal::Enabled, DriveState::QuickStopActive).1;
        assert_eq!(words, [0x00, 0x06, 0x07, 0x0F]);
    }

    #[test]
    fn every_state_leads_to_power_off() {
        for from in STATES {
            let state = drive_to(PowerGoal::Disabled, from).0;
            assert!(
                matches!(state, DriveState::SwitchOnDisabled | DriveState::Fault),
                "from {from}"
            );
        }
        let words = drive_to(PowerGoal::Disabled, DriveState::OperationEnabled).1;
        assert_eq!(words, [0x07, 0x06, 0x00]);
    }

    #[test]
    fn a_quick_stop_is_held() {
        let (state, words) = drive_to(PowerGoal::QuickStopped, DriveState::OperationEnabled);
        assert_eq!((state, words.as_slice()), (DriveState::QuickStopActive, &[0x02_u16][..]));
        let mut control = PowerControl::new(1);
        control.set_goal(PowerGoal::QuickStopped);
        let word = control.controlword(DriveState::QuickStopActive);
        assert_eq!(word, Some(Controlword(0x02)), "it goes on saying so");
        assert_eq!(control.controlword(DriveState::SwitchOnDisabled), None);
    }

    #[test]
    fn a_fault_reset_has_a_real_edge() {
        let mut control = PowerControl::new(1);
        control.set_goal(PowerGoal::Enabled);
        control.reset_fault();
        let mut words = Vec::new();
        let mut state = DriveState::Fault;
        let mut before = Controlword::of(Command::FaultReset);
        while let Some(word) = control.controlword(state) {
            // The drive takes every third frame only.
            if words.len() % 3 == 2 {
                state = answer(state, word, before);
                before = word;
            }
            words.push(word.0);
            control.sent();
        }
        assert_eq!(words, [0x00, 0x00, 0x00, 0x80, 0x80, 0x80]);
        assert_eq!(state, DriveState::SwitchOnDisabled);
        assert_eq!((control.reset_state(), control.goal()), (ResetState::Idle, PowerGoal::None));
    }

    #[test]
    fn a_level_that_was_not_sent_does_not_count() {
        let mut control = PowerControl::new(1);
        control.reset_fault();
        for _ in 0..1000 {
            assert_eq!(control.controlword(DriveState::Fault), Some(Controlword(0)));
        }
        for _ in 0..3 {
            control.sent();
        }
        assert_eq!(control.controlword(DriveState::Fault), Some(Controlword(0x80)));
    }

    #[test]
    fn a_fault_that_stays_ends_the_reset() {
        let mut control = PowerControl::new(2);
        control.reset_fault();
        let mut frames = 0;
        while control.controlword(DriveState::Fault).is_some() {
            control.sent();
            frames += 1;
            assert!(frames < 10_000);
        }
        assert_eq!(control.reset_state(), ResetState::Failed);
        assert_eq!(frames, 6 + 600);
        control.reset_fault();
        assert_eq!(control.controlword(DriveState::Fault), Some(Controlword(0)));
    }

    #[test]
    fn the_reaction_to_a_fault_is_waited_for() {
        let mut control = PowerControl::new(1);
        control.reset_fault();
        assert_eq!(control.controlword(DriveState::FaultReactionActive), None);
        assert_eq!(control.reset_state(), ResetState::Low);
        assert_eq!(control.controlword(DriveState::Fault), Some(Controlword(0)));
    }
}
