//! Setup of a drive: how much of its configuration is known.

use super::script::Script;
use crate::guard::terms::GuardInput;

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

pub(crate) const RETRY_NS: u64 = 500_000_000;

#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) struct Reachability {
    pub(crate) gateway: bool,
    pub(crate) heartbeat: bool,
    /// The node is in Operational, as far as the host can tell.
    pub(crate) operational: bool,
}

impl Reachability {
    pub(crate) fn of(input: &GuardInput) -> Self {
        Self {
            gateway: input.path.is_ready,
            heartbeat: !input.drive.heartbeat_lost,
            operational: !input.drive.not_operational,
        }
    }

    /// Returns whether a part of the connection is lost since `before`; a part that remains lost
    /// does not count, so that a verification can complete.
    pub(crate) fn is_lost_since(self, before: Self) -> bool {
        before.gateway && !self.gateway
            || before.heartbeat && !self.heartbeat
            || before.operational && !self.operational
    }
}

/// Verification that a drive still has its configuration: during a connection loss it may have
/// restarted unnoticed, and then its process data have another meaning.
#[expect(clippy::large_enum_variant, reason = "a box would allocate in the cycle")]
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) enum Verification {
    /// The connection was never lost, or the configuration is verified.
    #[default]
    Complete,
    /// The drive is to be asked, from this time on.
    Due {
        from_ns: u64,
    },
    Running(Script),
}

/// Part of an axis in its node, which several axes may share: the node is configured once for all of them,
/// and one of them uses its SDO client to stop.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct NodeShare {
    /// Axes of the node in the table.
    pub(crate) count: usize,
    /// The axis is the first of its node in the table: it has the steps of the configuration.
    pub(crate) is_first: bool,
    /// All axes of the node are ready for its configuration.
    pub(crate) may_begin: bool,
    /// The axis wants its node to be configured.
    pub(crate) is_setup_wanted: bool,
    /// The axis may begin SDO transfers to read the state of its drive and to stop it.
    pub(crate) may_poll: bool,
    /// An axis of the node has a fresh status.
    pub(crate) is_heard: bool,
}

impl Default for NodeShare {
    /// The only axis of its node.
    fn default() -> Self {
        Self {
            count: 1,
            is_first: true,
            may_begin: true,
            is_setup_wanted: false,
            may_poll: true,
            is_heard: false,
        }
    }
}
