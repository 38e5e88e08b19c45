//! Stop of an axis: its cause, the command for each state of the drive, and its completion.

use std::fmt;

use ecan_canopen::{Command, DriveState};

use super::power::PowerGoal;
use crate::guard::input::HoldReason;

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
    /// [`quick_stop`](crate::Cia402::quick_stop).
    QuickStop,
    /// [`disable`](crate::Cia402::disable).
    Disable,
    /// [`stop_all`](crate::Cia402::stop_all).
    StopAll,
    /// [`begin_shutdown`](crate::Cia402::begin_shutdown).
    Shutdown,
    /// The axis held in a mode in which its drive would continue to move.
    Held(HoldReason),
    /// A mode change or homing switches the drive off.
    Procedure,
    /// The drive was not enabled in time.
    EnableTimedOut,
    /// [`configure`](crate::Cia402::configure), while the drive was enabled.
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
