//! Events that the parts of an axis report to the axis.

use ecan_canopen::{OperatingMode, StepFailure};

/// Event of a part of an axis. Only the [`Axis`](super::axis::Axis) applies it, since it changes other
/// parts, too.
///
/// | part | event | effect |
/// | --- | --- | --- |
/// | setup | `SetupReady` | the configuration of the drive begins |
/// | setup | `StepsDone` | the values that were read are in force, and the mode is written |
/// | setup | `SetupDone` | the axis is configured, its node is watched |
/// | setup, procedure | `SetupFailed` | the axis must be configured again |
/// | setup | `NotStopped` | the configuration ends: the drive may be moving and does not answer |
/// | setup | `NoAnswer` | the node may be in NMT Stopped, and is woken |
/// | setup | `ModeRestored` | the mode is in force, and the verification continues |
/// | setup | `ConfigurationDiffers` | the drive is read again, and stopped if necessary |
/// | first contact | `Adopt` | the adoption begins with the verification of the configuration |
/// | first contact | `Adopted` | the axis is configured, the drive remains enabled |
/// | first contact | `EnabledDriveFound` | the drive is stopped |
/// | procedure | `SwitchOff` | the drive is switched off for the procedure |
/// | procedure | `HomingSet` | the mode is homing, and the drive is enabled |
/// | procedure | `ModeSet` | the mode is in force |
/// | recovery | `Configure`, `ResetFault`, `Enable`, `Resume` | the command of the same name |
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum AxisEvent {
    SetupReady,
    StepsDone,
    SetupDone,
    SetupFailed(StepFailure),
    NotStopped,
    NoAnswer,
    ModeRestored(OperatingMode),
    ConfigurationDiffers,
    Adopt { target: i32 },
    Adopted,
    EnabledDriveFound,
    SwitchOff,
    HomingSet,
    ModeSet(OperatingMode),
    Configure,
    ResetFault,
    Enable,
    Resume,
}
