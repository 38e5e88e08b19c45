//! State machine of an axis: which command the drive executes.

use ecan_canopen::{Controlword, DriveState};

use super::power::{FaultReset, PowerGoal};
use super::script::Script;

/// State of an axis: the command that its drive executes.
///
/// In parallel with it, the [`MotionGuard`](super::MotionGuard) decides about targets, the
/// [`Verification`](super::verification::Verification) checks the configuration after a connection
/// loss, and a [`Procedure`](super::procedure::Procedure) (mode change or homing) issues commands
/// as the application does.
///
/// | from | event | to |
/// | --- | --- | --- |
/// | any | configure | `Configuring` |
/// | any configured | the drive restarted, or its configuration is not verified | `Unconfigured` |
/// | `Configuring` | all steps done | `SettingMode` |
/// | `SettingMode` | the drive displays the mode | `Standby` |
/// | `Configuring`, `SettingMode` | a step failed | `SetupFailed` |
/// | any configured | the mode cannot be restored after homing | `SetupFailed` |
/// | any configured | enable | `Active` if the guard follows targets, else `Enabling` |
/// | `Enabling` | the first target is sent | `Active` |
/// | `Enabling` | the drive holds an old target far from its position | `ReEnabling` |
/// | `ReEnabling` | drive in Switch On Disabled | `Enabling` |
/// | `Enabling`, `ReEnabling` | drive in Fault | `Standby` |
/// | `Enabling`, `ReEnabling` | timeout | `Off` |
/// | `Active`, `Enabling`, `ReEnabling` | the guard holds | `Standby`; in a mode in which the drive would continue to move, `QuickStop` |
/// | `Standby` | the same, and the axis may become active again by itself | `Resuming` |
/// | `Resuming` | the first target is sent | `Active` |
/// | `Resuming` | the drive left Operation Enabled, or holds an old target | `Standby` |
/// | any configured | disable | `Off` |
/// | `Off` | the drive is not off | `SwitchingOff` |
/// | `SwitchingOff` | drive in Switch On Disabled or Fault | `Off` |
/// | `SwitchingOff` | timeout | `Standby` |
/// | any configured | quick stop | `QuickStop` |
/// | any configured | reset fault | `ResettingFault` |
/// | `ResettingFault` | the drive left Fault, or stays in it | `Standby` |
/// | any configured | shutdown, after `Off` | `Releasing`, then `Off` |
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) enum AxisState {
    /// Not configured, or no longer: the drive restarted.
    #[default]
    Unconfigured,
    Configuring,
    /// The mode is written, and the drive must display it.
    SettingMode(Script),
    SetupFailed,
    /// Configured; the drive receives no command.
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
    /// The axis held while its drive stayed enabled, and becomes active again by itself.
    Resuming,
    /// The drive is off. Nothing is sent unless it leaves this state.
    Off,
    /// The drive is switched off, step by step.
    SwitchingOff {
        since_ns: u64,
    },
    /// The drive stops by its own rules and remains stopped.
    QuickStop,
    ResettingFault(FaultReset),
    /// Shutdown: the drive stops watching the host's heartbeat.
    Releasing(Script),
}

impl AxisState {
    pub(crate) fn is_configured(&self) -> bool {
        !matches!(
            self,
            Self::Unconfigured | Self::Configuring | Self::SettingMode(_) | Self::SetupFailed
        )
    }

    /// Whether the next command to the drive can only be its configuration.
    pub(crate) fn awaits_configuration(&self) -> bool {
        matches!(self, Self::Unconfigured | Self::SetupFailed)
    }

    /// Start of the command to enable, while it is not complete.
    pub(crate) fn enabling_since_ns(&self) -> Option<u64> {
        match *self {
            Self::Enabling { since_ns } | Self::ReEnabling { since_ns } => Some(since_ns),
            _ => None,
        }
    }

    /// Whether the host commands the drive, so that its node must be Operational.
    pub(crate) fn is_commanding(&self) -> bool {
        self.power_goal() != PowerGoal::None || matches!(self, Self::ResettingFault(_))
    }

    pub(crate) fn power_goal(&self) -> PowerGoal {
        match self {
            Self::Enabling { .. } | Self::Active => PowerGoal::Enabled,
            Self::ReEnabling { .. }
            | Self::Off
            | Self::SwitchingOff { .. }
            | Self::Releasing(_) => PowerGoal::Disabled,
            Self::QuickStop => PowerGoal::QuickStopped,
            Self::Unconfigured
            | Self::Configuring
            | Self::SettingMode(_)
            | Self::SetupFailed
            | Self::Standby
            | Self::Resuming
            | Self::ResettingFault(_) => PowerGoal::None,
        }
    }

    /// Controlword to send to a drive in this state; `None` if none is to be sent.
    pub(crate) fn controlword(&self, drive: DriveState) -> Option<Controlword> {
        match self {
            Self::ResettingFault(reset) => reset.controlword(drive),
            _ => self.power_goal().command(drive).map(Controlword::of),
        }
    }

    /// Next state when the guard begins to hold, or the drive reports a fault: nothing is
    /// commanded that could move the axis, and a drive that would continue to move is stopped.
    pub(crate) fn after_hold(self, must_stop: bool) -> Self {
        match self {
            Self::Off | Self::SwitchingOff { .. } | Self::Releasing(_) | Self::QuickStop => self,
            _ if must_stop => Self::QuickStop,
            _ => Self::Standby,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const HOLDING: [(AxisState, AxisState, AxisState); 5] = [
        (AxisState::Active, AxisState::Standby, AxisState::QuickStop),
        (AxisState::Enabling { since_ns: 1 }, AxisState::Standby, AxisState::QuickStop),
        (AxisState::ReEnabling { since_ns: 1 }, AxisState::Standby, AxisState::QuickStop),
        (AxisState::Off, AxisState::Off, AxisState::Off),
        (AxisState::QuickStop, AxisState::QuickStop, AxisState::QuickStop),
    ];

    #[test]
    fn hold_never_enables_and_stops_a_moving_drive() {
        for (state, at_rest, moving) in HOLDING {
            assert_eq!(state.after_hold(false), at_rest, "{state:?}");
            assert_eq!(state.after_hold(true), moving, "{state:?}");
        }
    }

    #[test]
    fn only_configured_states_command_the_drive() {
        let unconfigured = [
            AxisState::Unconfigured,
            AxisState::Configuring,
            AxisState::SettingMode(Script::default()),
            AxisState::SetupFailed,
        ];
        for state in unconfigured {
            assert!(!state.is_configured() && !state.is_commanding(), "{state:?}");
            assert_eq!(state.controlword(DriveState::OperationEnabled), None);
        }
        assert!(!AxisState::Standby.is_commanding() && AxisState::Standby.is_configured());
    }
}
