//! Setup of a drive: how much of its configuration is known.

use super::script::Script;

/// Setup of a drive, in parallel with the command that it executes.
///
/// | from | event | to |
/// | --- | --- | --- |
/// | any | configure | `Requested` |
/// | `Requested` | the drive is off, or never answered | `Configuring` |
/// | `Requested` | the drive was enabled when it answered last, and answers no more | `Failed` |
/// | `Configuring` | all steps done | `SettingMode` |
/// | `SettingMode` | the drive displays the mode | `Complete` |
/// | `Configuring`, `SettingMode` | a step failed | `Failed` |
/// | `Unconfigured` | the new owner adopts the enabled drive | `Complete` |
/// | any but `Requested` | the drive restarted, or its configuration differs | `Unconfigured` |
/// | `Complete` | the mode cannot be restored after homing | `Failed` |
/// | `Complete` | the drive no longer watches the host, after a shutdown | `Unconfigured` |
/// | `Configuring`, `SettingMode` | stop of a drive that never answered | `Unconfigured` |
#[expect(clippy::large_enum_variant, reason = "a box would allocate in the cycle")]
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) enum SetupState {
    /// Not configured, or no longer: the drive restarted.
    #[default]
    Unconfigured,
    /// The configuration begins when the drive has stopped. Until then a drive that is configured is
    /// stopped as before: a stop by SDO would overtake RPDOs that wait for their SYNC.
    Requested {
        is_configured: bool,
    },
    Configuring,
    /// The mode is written, and the drive must display it.
    SettingMode(Script),
    Failed,
    Complete,
}

impl SetupState {
    pub(crate) fn is_complete(&self) -> bool {
        matches!(self, Self::Complete)
    }

    /// Returns whether the drive has its configuration, so that process data command and report it.
    pub(crate) fn has_process_data(&self) -> bool {
        matches!(self, Self::Complete | Self::Requested { is_configured: true })
    }

    /// Returns whether the configuration is requested or runs.
    pub(crate) fn is_pending(&self) -> bool {
        matches!(self, Self::Requested { .. }) || self.is_running()
    }

    /// Returns whether configuration steps are being executed.
    pub(crate) fn is_running(&self) -> bool {
        matches!(self, Self::Configuring | Self::SettingMode(_))
    }
}
