//! Controlwords that bring a drive to a state (CiA 402-2, 8.2), and stops with their causes and completion.

use std::fmt;

use ecan_canopen::{Command, Controlword, DriveState};

use crate::guard::terms::HoldReason;

#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) enum PowerGoal {
    #[default]
    None,
    Enabled,
    /// Switch On Disabled, step by step: the drive first leaves operation by its own rules (0x605C),
    /// then switches power off.
    Disabled,
    /// Quick stop by the drive's own rules (0x605A); the drive remains there. A drive that is not
    /// enabled is switched off.
    QuickStopped,
    /// Quick stop, then power off at rest.
    QuickStoppedThenDisabled,
}

impl PowerGoal {
    /// Command for a drive in this state; `None` if no command is to be sent. Voltage is never disabled
    /// while a quick stop brakes: the motor would coast. Real-time safe.
    ///
    /// | state | Enabled | Disabled | QuickStopped | QuickStoppedThenDisabled |
    /// | --- | --- | --- | --- | --- |
    /// | Not Ready To Switch On | wait | wait | wait | wait |
    /// | Switch On Disabled | shutdown 0x06 | reached | reached | reached |
    /// | Ready To Switch On | switch on 0x07 | disable voltage 0x00 | quick stop 0x02 | quick stop 0x02 |
    /// | Switched On | enable operation 0x0F | shutdown 0x06 | quick stop 0x02 | quick stop 0x02 |
    /// | Operation Enabled | 0x0F | disable operation 0x07 | quick stop 0x02 | quick stop 0x02 |
    /// | Quick Stop Active, moving | quick stop 0x02 | quick stop 0x02 | quick stop 0x02 | quick stop 0x02 |
    /// | Quick Stop Active, at rest | disable voltage 0x00 | disable voltage 0x00 | quick stop 0x02 | disable voltage 0x00 |
    /// | Fault Reaction Active | wait | wait | wait | wait |
    /// | Fault | nothing: a reset is a separate command | reached | reached | reached |
    pub(crate) fn command(self, state: DriveState, is_at_rest: bool) -> Option<Command> {
        use DriveState as S;
        match (self, state) {
            (Self::None, _)
            | (_, S::NotReadyToSwitchOn | S::FaultReactionActive | S::Fault)
            | (
                Self::Disabled | Self::QuickStopped | Self::QuickStoppedThenDisabled,
                S::SwitchOnDisabled,
            ) => None,
            (Self::Enabled, S::SwitchOnDisabled) => Some(Command::Shutdown),
            (Self::Enabled, S::ReadyToSwitchOn) => Some(Command::SwitchOn),
            (Self::Enabled, S::SwitchedOn | S::OperationEnabled) => Some(Command::EnableOperation),
            (Self::Disabled, S::OperationEnabled) => Some(Command::DisableOperation),
            (Self::Disabled, S::SwitchedOn) => Some(Command::Shutdown),
            (Self::Disabled, S::ReadyToSwitchOn) => Some(Command::DisableVoltage),
            (
                Self::Enabled | Self::Disabled | Self::QuickStoppedThenDisabled,
                S::QuickStopActive,
            ) if is_at_rest => Some(Command::DisableVoltage),
            (_, S::QuickStopActive)
            | (
                Self::QuickStopped | Self::QuickStoppedThenDisabled,
                S::ReadyToSwitchOn | S::SwitchedOn | S::OperationEnabled,
            ) => Some(Command::QuickStop),
        }
    }
}

/// Frames for which a level of the fault reset bit is held, per SYNC period: a drive that takes
/// its RPDO with SYNC uses the last one before each.
const LEVEL_FRAMES: u16 = 3;
/// Frames after which a drive that is still in fault has rejected the reset, in levels.
const RESET_LEVELS: u16 = 100;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum ResetLevel {
    /// The bit is low, so that the drive sees an edge.
    Low,
    /// The bit is high; the drive must leave the fault.
    High,
    /// The drive stays in fault: the cause persists.
    Failed,
}

/// Reset of a fault: 0x00 with the bit low, then 0x80, each for several frames, until the drive
/// has left the fault. A frame that was not sent does not count, so each level is really on the bus
/// before the next one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct FaultReset {
    level: ResetLevel,
    level_frames: u16,
    frames: u16,
}

impl FaultReset {
    /// Creates a reset at the low level. `cycles_per_sync` stretches the levels.
    pub(crate) fn new(cycles_per_sync: u32) -> Self {
        let cycles = u16::try_from(cycles_per_sync.max(1)).unwrap_or(u16::MAX);
        let level_frames = LEVEL_FRAMES.saturating_mul(cycles);
        Self { level: ResetLevel::Low, level_frames, frames: 0 }
    }

    pub(crate) fn controlword(&self, state: DriveState) -> Option<Controlword> {
        let command = match (self.level, state) {
            (ResetLevel::Low, DriveState::Fault) => Command::DisableVoltage,
            (ResetLevel::High, DriveState::Fault) => Command::FaultReset,
            _ => return None,
        };
        Some(Controlword::of(command))
    }

    pub(crate) fn count_frame(&mut self) {
        let (limit, next) = match self.level {
            ResetLevel::Low => (self.level_frames, ResetLevel::High),
            ResetLevel::High => {
                (self.level_frames.saturating_mul(RESET_LEVELS), ResetLevel::Failed)
            }
            ResetLevel::Failed => return,
        };
        self.frames = self.frames.saturating_add(1);
        if self.frames >= limit {
            self.frames = 0;
            self.level = next;
        }
    }

    pub(crate) fn has_failed(&self) -> bool {
        self.level == ResetLevel::Failed
    }

    pub(crate) fn is_complete(&self, state: DriveState) -> bool {
        !matches!(state, DriveState::Fault | DriveState::FaultReactionActive)
    }
}

/// Time after which a drive that still reports Operation Enabled has not obeyed a quick stop, which
/// is optional in CiA 402: it is commanded to stop by its ramp for switching off (0x605C) then.
const QUICK_STOP_NS: u64 = 250_000_000;

/// Time after which it has not obeyed that, either: its voltage is disabled then.
const RAMP_NS: u64 = 2_000_000_000;

/// Time after which a drive that still reports Operation Enabled has not obeyed the command to
/// switch off by its own ramp: it is quick-stopped then.
pub(crate) const DISABLE_NS: u64 = 30_000_000_000;

/// Longest time between two cycles that counts as time with reports: a paused host got none.
const LONGEST_CYCLE_NS: u64 = 50_000_000;

/// Cause of a stop.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum StopCause {
    /// [`StopKind::QuickStop`](crate::StopKind::QuickStop).
    QuickStop,
    /// [`StopKind::Disable`](crate::StopKind::Disable).
    Disable,
    /// [`StopKind::QuickStopThenDisable`](crate::StopKind::QuickStopThenDisable).
    StopAll,
    /// [`begin_shutdown`](crate::Cia402::begin_shutdown).
    Shutdown,
    /// The axis held in a mode in which its drive would continue to move.
    Held(HoldReason),
    /// A mode change or homing switches the drive off.
    Procedure,
    /// The drive was not enabled in time.
    EnableTimedOut,
    /// [`configure`](crate::AxisHandle::configure), while the drive was enabled.
    Configure,
    /// The drive was enabled when this object began to command it, or when it was found with another
    /// configuration.
    Takeover,
}

impl StopCause {
    /// Returns whether the application commanded the stop.
    pub fn is_commanded(self) -> bool {
        matches!(self, Self::QuickStop | Self::Disable | Self::StopAll | Self::Shutdown)
    }
}

impl fmt::Display for StopCause {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::QuickStop => f.write_str("quick stop"),
            Self::Disable => f.write_str("disabled"),
            Self::StopAll => f.write_str("all axes stopped"),
            Self::Shutdown => f.write_str("shutdown"),
            Self::Held(reason) => write!(f, "hold, {reason}"),
            Self::Procedure => f.write_str("mode change or homing"),
            Self::EnableTimedOut => f.write_str("not enabled in time"),
            Self::Configure => f.write_str("configuration"),
            Self::Takeover => f.write_str("the drive was enabled before"),
        }
    }
}

/// A stop that was commanded, until the axis gets another command.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Stop {
    pub(crate) cause: StopCause,
    /// Braking by quick stop, in place of the drive's own rules for switching off (0x605C).
    quick: bool,
    /// The drive is switched off at the end, in place of remaining in Quick Stop Active.
    off: bool,
    pub(crate) since_ns: u64,
    /// Time of the last command; only a later status confirms the stop.
    pub(crate) commanded_ns: u64,
    /// Time for which the drive reported its state: only then can it have received the command.
    heard_ns: u64,
    noted_ns: u64,
    /// Time of the command to enable that waits for the end of the stop.
    pub(crate) enable_since_ns: Option<u64>,
}

impl Stop {
    pub(crate) fn new(cause: StopCause, now_ns: u64) -> Self {
        let quick =
            !matches!(cause, StopCause::Disable | StopCause::Shutdown | StopCause::Procedure);
        let off = !matches!(cause, StopCause::QuickStop | StopCause::Held(_));
        Self {
            cause,
            quick,
            off,
            since_ns: now_ns,
            commanded_ns: now_ns,
            heard_ns: 0,
            noted_ns: now_ns,
            enable_since_ns: None,
        }
    }

    /// The stop that both commands ask for: the stronger braking, and off if one of them includes it. A
    /// new stop cancels a command to enable that waits.
    pub(crate) fn and(self, later: Self) -> Self {
        let is_stronger = later.quick && !self.quick;
        Self {
            cause: if later.cause.is_commanded() { later.cause } else { self.cause },
            quick: self.quick || later.quick,
            off: self.off || later.off,
            commanded_ns: later.commanded_ns,
            since_ns: if is_stronger { later.since_ns } else { self.since_ns },
            heard_ns: if is_stronger { 0 } else { self.heard_ns },
            noted_ns: later.noted_ns,
            enable_since_ns: None,
        }
    }

    /// Returns this stop with a command to enable that waits for its end.
    pub(crate) fn then_enable(self, now_ns: u64) -> Self {
        Self { enable_since_ns: Some(now_ns), ..self }
    }

    /// The drive does not remain in Quick Stop Active.
    pub(crate) fn switch_off_at_rest(&mut self) {
        self.off = true;
    }

    /// Call once per cycle, with whether the drive's status is fresh.
    pub(crate) fn note_status(&mut self, is_fresh: bool, now_ns: u64) {
        let elapsed_ns = now_ns.saturating_sub(self.noted_ns).min(LONGEST_CYCLE_NS);
        self.noted_ns = now_ns;
        if is_fresh {
            self.heard_ns = self.heard_ns.saturating_add(elapsed_ns);
        }
    }

    pub(crate) fn goal(&self) -> PowerGoal {
        match (self.quick, self.off) {
            (true, false) => PowerGoal::QuickStopped,
            (true, true) => PowerGoal::QuickStoppedThenDisabled,
            (false, _) => PowerGoal::Disabled,
        }
    }

    /// Command for a drive in this state; `None` if it needs none. An unknown state gets the
    /// strongest command that never makes an enabled drive coast.
    pub(crate) fn command(&self, state: Option<DriveState>, is_at_rest: bool) -> Option<Command> {
        let Some(state) = state else { return Some(Command::QuickStop) };
        let elapsed_ns = self.heard_ns;
        let is_ignored = self.quick && elapsed_ns > QUICK_STOP_NS;
        match state {
            DriveState::OperationEnabled if self.quick && elapsed_ns > RAMP_NS => {
                return Some(Command::DisableVoltage);
            }
            DriveState::OperationEnabled if is_ignored => return Some(Command::DisableOperation),
            DriveState::OperationEnabled if !self.quick && elapsed_ns > DISABLE_NS => {
                return Some(Command::QuickStop);
            }
            DriveState::ReadyToSwitchOn | DriveState::SwitchedOn if is_ignored => {
                return Some(Command::DisableVoltage);
            }
            _ => {}
        }
        self.goal().command(state, is_at_rest)
    }

    /// Returns whether a drive in this state needs no further command once it is at rest.
    pub(crate) fn is_reached(&self, state: DriveState) -> bool {
        match state {
            DriveState::QuickStopActive => self.goal() == PowerGoal::QuickStopped,
            DriveState::SwitchOnDisabled | DriveState::Fault => true,
            _ => false,
        }
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
    fn next_state(state: DriveState, word: Controlword, before: Controlword) -> DriveState {
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

    fn is_reached(goal: PowerGoal, state: DriveState) -> bool {
        use DriveState as S;
        match goal {
            PowerGoal::None => true,
            PowerGoal::Enabled => state == S::OperationEnabled,
            PowerGoal::Disabled | PowerGoal::QuickStoppedThenDisabled => {
                matches!(state, S::SwitchOnDisabled | S::Fault)
            }
            PowerGoal::QuickStopped => {
                matches!(state, S::QuickStopActive | S::SwitchOnDisabled | S::Fault)
            }
        }
    }

    fn drive_to(goal: PowerGoal, from: DriveState) -> (DriveState, Vec<u16>) {
        let (mut state, mut before, mut words) = (from, Controlword(0), Vec::new());
        for _ in 0..20 {
            if let Some(word) = goal.command(state, true).map(Controlword::of) {
                state = next_state(state, word, before);
                before = word;
                words.push(word.0);
            } else if matches!(
                state,
                DriveState::NotReadyToSwitchOn | DriveState::FaultReactionActive
            ) {
                state = next_state(state, before, before);
            }
            if is_reached(goal, state) {
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
        let words = drive_to(PowerGoal::QuickStoppedThenDisabled, DriveState::OperationEnabled).1;
        assert_eq!(words, [0x02, 0x00]);
    }

    #[test]
    fn braking_drive_keeps_its_voltage() {
        for goal in [
            PowerGoal::Enabled,
            PowerGoal::Disabled,
            PowerGoal::QuickStopped,
            PowerGoal::QuickStoppedThenDisabled,
        ] {
            let command = goal.command(DriveState::QuickStopActive, false);
            assert_eq!(command, Some(Command::QuickStop), "{goal:?}");
        }
    }

    #[test]
    fn quick_stop_command_is_repeated() {
        let (state, words) = drive_to(PowerGoal::QuickStopped, DriveState::OperationEnabled);
        assert_eq!((state, words.as_slice()), (DriveState::QuickStopActive, &[0x02_u16][..]));
        let goal = PowerGoal::QuickStopped;
        assert_eq!(goal.command(DriveState::QuickStopActive, true), Some(Command::QuickStop));
        assert_eq!(goal.command(DriveState::SwitchOnDisabled, true), None);
    }

    #[test]
    fn fault_reset_sends_a_real_edge() {
        let mut reset = FaultReset::new(1);
        let mut words = Vec::new();
        let mut state = DriveState::Fault;
        let mut before = Controlword::of(Command::FaultReset);
        while let Some(word) = reset.controlword(state) {
            // The drive takes every third frame only.
            if words.len() % 3 == 2 {
                state = next_state(state, word, before);
                before = word;
            }
            words.push(word.0);
            reset.count_frame();
        }
        assert_eq!(words, [0x00, 0x00, 0x00, 0x80, 0x80, 0x80]);
        assert_eq!(state, DriveState::SwitchOnDisabled);
        assert!(reset.is_complete(state) && !reset.has_failed());
    }

    #[test]
    fn level_that_was_not_sent_does_not_count() {
        let mut reset = FaultReset::new(1);
        for _ in 0..1000 {
            assert_eq!(reset.controlword(DriveState::Fault), Some(Controlword(0)));
        }
        for _ in 0..3 {
            reset.count_frame();
        }
        assert_eq!(reset.controlword(DriveState::Fault), Some(Controlword(0x80)));
    }

    #[test]
    fn persistent_fault_ends_the_reset() {
        let mut reset = FaultReset::new(2);
        let mut frames = 0;
        while reset.controlword(DriveState::Fault).is_some() {
            reset.count_frame();
            frames += 1;
            assert!(frames < 10_000);
        }
        assert!(reset.has_failed());
        assert_eq!(frames, 6 + 600);
        assert_eq!(reset.controlword(DriveState::Fault), None);
    }

    #[test]
    fn fault_reset_waits_for_the_fault_reaction() {
        let reset = FaultReset::new(1);
        assert_eq!(reset.controlword(DriveState::FaultReactionActive), None);
        assert!(!reset.is_complete(DriveState::FaultReactionActive));
        assert_eq!(reset.controlword(DriveState::Fault), Some(Controlword(0)));
    }

    fn stop(cause: StopCause) -> Stop {
        Stop::new(cause, 0)
    }

    #[test]
    fn second_stop_never_weakens_the_first() {
        let quick = stop(StopCause::QuickStop);
        let off = stop(StopCause::Disable);
        for both in [quick.and(off), off.and(quick)] {
            assert_eq!(both.goal(), PowerGoal::QuickStoppedThenDisabled);
        }
        assert_eq!(quick.and(quick).goal(), PowerGoal::QuickStopped);
        let waiting = Stop { enable_since_ns: Some(1), ..quick };
        assert_eq!(waiting.and(quick).enable_since_ns, None);
    }

    #[test]
    fn unknown_state_gets_a_quick_stop() {
        for cause in [StopCause::QuickStop, StopCause::Disable, StopCause::Takeover] {
            assert_eq!(stop(cause).command(None, false), Some(Command::QuickStop));
        }
    }

    /// The command to an enabled drive that has reported its state for so long.
    fn command_after(cause: StopCause, heard_ns: u64) -> Option<Command> {
        let mut stop = stop(cause);
        let cycle_ns = LONGEST_CYCLE_NS / 5;
        (1..=heard_ns / cycle_ns).for_each(|nth| stop.note_status(true, nth * cycle_ns));
        stop.note_status(true, heard_ns);
        stop.command(Some(DriveState::OperationEnabled), false)
    }

    #[test]
    fn disobedient_drive_gets_a_stronger_command() {
        let quick = |heard_ns| command_after(StopCause::QuickStop, heard_ns);
        assert_eq!(quick(QUICK_STOP_NS), Some(Command::QuickStop));
        assert_eq!(quick(QUICK_STOP_NS + 1), Some(Command::DisableOperation));
        assert_eq!(quick(RAMP_NS + 1), Some(Command::DisableVoltage));
        let off = |heard_ns| command_after(StopCause::Disable, heard_ns);
        assert_eq!(off(DISABLE_NS), Some(Command::DisableOperation));
        assert_eq!(off(DISABLE_NS + 1), Some(Command::QuickStop));
    }

    #[test]
    fn only_time_with_reports_makes_a_drive_disobedient() {
        let mut quick = stop(StopCause::QuickStop);
        quick.note_status(false, u64::MAX / 2);
        let enabled = Some(DriveState::OperationEnabled);
        assert_eq!(quick.command(enabled, false), Some(Command::QuickStop));
        for nth in 1..=6 {
            // Every second report is lost.
            quick.note_status(nth % 2 == 0, u64::MAX / 2 + nth * 100_000_000);
        }
        assert_eq!(quick.command(enabled, false), Some(Command::QuickStop));
        for nth in 7..=12 {
            quick.note_status(nth % 2 == 0, u64::MAX / 2 + nth * 100_000_000);
        }
        assert_eq!(quick.command(enabled, false), Some(Command::DisableOperation));
    }

    /// A pause of the host, which then sees the report of the time before.
    #[test]
    fn pause_makes_no_drive_disobedient() {
        let mut quick = stop(StopCause::QuickStop);
        quick.note_status(true, 10_000_000_000);
        let enabled = Some(DriveState::OperationEnabled);
        assert_eq!(quick.command(enabled, false), Some(Command::QuickStop));
    }

    #[test]
    fn stop_is_reached_off_or_in_quick_stop() {
        let quick = stop(StopCause::QuickStop);
        assert!(quick.is_reached(DriveState::QuickStopActive));
        assert!(!stop(StopCause::StopAll).is_reached(DriveState::QuickStopActive));
        for cause in [StopCause::QuickStop, StopCause::Disable] {
            assert!(stop(cause).is_reached(DriveState::Fault));
            for state in [
                DriveState::OperationEnabled,
                DriveState::SwitchedOn,
                DriveState::ReadyToSwitchOn,
                DriveState::FaultReactionActive,
            ] {
                assert!(!stop(cause).is_reached(state), "{state}");
            }
        }
    }
}
