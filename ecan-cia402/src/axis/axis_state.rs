//! State machine of an axis: which command the drive executes.

use ecan_canopen::{Controlword, DriveState};

use super::power::{FaultReset, PowerGoal, Stop, StopCause};
use super::script::Script;

/// State of an axis: the command that its drive executes.
///
/// In parallel with it, the [`SetupState`](super::setup::SetupState) states how much of the drive's
/// configuration is known, the [`TakeoverState`](super::takeover::TakeoverState) what is known about
/// a drive at the first contact, the [`MotionGuard`](super::MotionGuard) decides about targets, the
/// [`Verification`](super::setup::Verification) checks the configuration after a connection
/// loss, and a [`Procedure`](super::procedure::Procedure) (mode change or homing) issues commands
/// as the application does.
///
/// "Any" includes every setup: a drive that process data do not reach is stopped by SDO.
///
/// | from | event | to |
/// | --- | --- | --- |
/// | any | quick stop, disable, stop all, shutdown | `Stopping` |
/// | any | the drive is enabled at the first contact, or has another configuration | `Stopping` |
/// | `Stopping` | another stop | `Stopping` by the stronger of both |
/// | `Stopping` | enable | `Stopping`; `Enabling` follows when it is complete |
/// | `Stopping` | fresh status: off, or in Quick Stop Active after a quick stop with process data, and at rest | `Stopped` |
/// | `Stopping` | the drive never reported anything, and does not answer | `Stopped` |
/// | `Stopped` | fresh status: the drive is enabled nevertheless | `Stopping` |
/// | any but `Stopping` | enable | `Active` if the guard follows targets, else `Enabling` |
/// | `Enabling` | the first target is sent | `Active` |
/// | `Enabling` | the drive holds an old target far from its position | `ReEnabling` |
/// | `ReEnabling` | drive in Switch On Disabled | `Enabling` |
/// | `Enabling`, `ReEnabling` | drive in Fault | `Standby` |
/// | `Enabling`, `ReEnabling` | timeout | `Stopping` |
/// | `Active`, `Enabling`, `ReEnabling` | the guard holds, in a position mode | `Standby` |
/// | `Active`, `Enabling`, `ReEnabling` | the guard holds, in another mode | `Stopping` |
/// | `Standby` | the guard held, and the axis may become active again automatically | `Resuming` |
/// | `Resuming` | the first target is sent | `Active` |
/// | `Resuming` | the drive left Operation Enabled, or holds an old target | `Standby` |
/// | any, with the drive in Fault or Fault Reaction Active | reset fault | `ResettingFault` |
/// | `ResettingFault` | the drive left Fault, or stays in it | `Standby` |
/// | `Stopped` | shutdown | `Releasing`, then `Standby` |
/// | `Stopped`, `Standby`, `Active`, ... | the drive restarted | `Standby` |
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[expect(clippy::large_enum_variant, reason = "a box would allocate in the cycle")]
pub(crate) enum AxisState {
    /// The drive receives no command.
    #[default]
    Standby,
    /// The guard establishes the position, and the drive is brought to Operation Enabled.
    Enabling {
        since_ns: u64,
    },
    /// The drive is switched off, so that it drops an old target, and then enabled.
    ReEnabling {
        since_ns: u64,
    },
    /// The drive is enabled and follows targets.
    Active,
    /// The axis held while its drive stayed enabled, and becomes active again automatically.
    Resuming,
    /// The drive is being stopped. Only completion ends it.
    Stopping(Stop),
    /// The drive reported that it has stopped.
    Stopped(Stop),
    ResettingFault(FaultReset),
    /// Shutdown: the drive stops watching the host's heartbeat.
    Releasing(Script),
}

impl AxisState {
    /// Start of the command to enable, while it is not complete.
    pub(crate) fn enabling_since_ns(&self) -> Option<u64> {
        match *self {
            Self::Enabling { since_ns } | Self::ReEnabling { since_ns } => Some(since_ns),
            Self::Stopping(stop) => stop.enable_since_ns,
            _ => None,
        }
    }

    /// The stop that is pending or complete.
    pub(crate) fn stop(&self) -> Option<&Stop> {
        match self {
            Self::Stopping(stop) | Self::Stopped(stop) => Some(stop),
            _ => None,
        }
    }

    pub(crate) fn is_stopping(&self) -> bool {
        matches!(self, Self::Stopping(_))
    }

    /// The state after a command to stop.
    pub(crate) fn stopped_by(&self, cause: StopCause, now_ns: u64) -> Self {
        let later = Stop::new(cause, now_ns);
        Self::Stopping(self.stop().map_or(later, |before| before.and(later)))
    }

    /// Returns whether the host commands the drive to do more than to stop, so that its node must be
    /// Operational.
    pub(crate) fn needs_operational(&self) -> bool {
        self.stop().is_none()
            && (self.power_goal() != PowerGoal::None || matches!(self, Self::ResettingFault(_)))
    }

    pub(crate) fn power_goal(&self) -> PowerGoal {
        match self {
            Self::Enabling { .. } | Self::Active => PowerGoal::Enabled,
            Self::ReEnabling { .. } | Self::Releasing(_) => PowerGoal::Disabled,
            Self::Stopping(stop) | Self::Stopped(stop) => stop.goal(),
            Self::Standby | Self::Resuming | Self::ResettingFault(_) => PowerGoal::None,
        }
    }

    /// Controlword to send to a drive in this state; `None` if none is to be sent.
    pub(crate) fn controlword(
        &self,
        drive: Option<DriveState>,
        is_at_rest: bool,
    ) -> Option<Controlword> {
        if let Some(stop) = self.stop() {
            return stop.command(drive, is_at_rest).map(Controlword::of);
        }
        let drive = drive?;
        match self {
            Self::ResettingFault(reset) => reset.controlword(drive),
            _ => self.power_goal().command(drive, is_at_rest).map(Controlword::of),
        }
    }

    /// Next state when the guard begins to hold, or the drive reports a fault: nothing is
    /// commanded that could move the axis, and a drive that would continue to move is stopped.
    pub(crate) fn after_hold(self, cause: StopCause, must_stop: bool, now_ns: u64) -> Self {
        match self {
            Self::Stopping(_) | Self::Stopped(_) | Self::Releasing(_) => self,
            _ if must_stop => self.stopped_by(cause, now_ns),
            _ => Self::Standby,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::guard::terms::HoldReason;
    use ecan_canopen::Command;

    const HELD: StopCause = StopCause::Held(HoldReason::BusOff);
    const COMMANDING: [AxisState; 4] = [
        AxisState::Active,
        AxisState::Enabling { since_ns: 1 },
        AxisState::ReEnabling { since_ns: 1 },
        AxisState::Resuming,
    ];

    #[test]
    fn hold_never_enables_and_stops_a_moving_drive() {
        for state in COMMANDING {
            assert_eq!(state.after_hold(HELD, false, 5), AxisState::Standby, "{state:?}");
            let stopped = state.after_hold(HELD, true, 5);
            assert_eq!(stopped.power_goal(), PowerGoal::QuickStopped, "{state:?}");
        }
        let off = AxisState::Stopped(Stop::new(StopCause::Disable, 1));
        assert_eq!(off.after_hold(HELD, true, 5), off);
    }

    #[test]
    fn stop_begins_in_every_state_and_is_never_weakened() {
        let quick = AxisState::default().stopped_by(StopCause::QuickStop, 1);
        let states = COMMANDING.into_iter().chain([AxisState::Standby, quick]);
        for state in states {
            let stopping = state.stopped_by(StopCause::StopAll, 2);
            assert!(stopping.is_stopping(), "{state:?}");
            let word = stopping.controlword(Some(DriveState::OperationEnabled), false);
            assert_eq!(word, Some(Controlword::of(Command::QuickStop)), "{state:?}");
        }
        let off = quick.stopped_by(StopCause::Disable, 2);
        let braking = off.controlword(Some(DriveState::QuickStopActive), false);
        assert_eq!(braking, Some(Controlword::of(Command::QuickStop)));
    }

    #[test]
    fn standby_sends_no_command() {
        for drive in [None, Some(DriveState::OperationEnabled), Some(DriveState::Fault)] {
            assert_eq!(AxisState::Standby.controlword(drive, true), None);
        }
        assert!(!AxisState::Standby.needs_operational());
    }
}
