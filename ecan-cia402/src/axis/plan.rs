//! Plan of an axis: its configuration, what follows from that, and the events that its parts report to it.

use ecan_canopen::{Network, NodeHandle, OperatingMode, StepFailure, object};
use ecan_protocol::can::CanId;

use super::config::{AxisConfig, Takeover};
use super::pdo_layout::{CommandLayout, PdoLayout};
use super::units::ScaleSource;

/// Least time for which a reported status counts as present: a round of SDO transfers.
const FRESH_NS: u64 = 100_000_000;

/// Least time for which a reported status counts as present, in SYNC periods; the larger of this and
/// [`FRESH_NS`] applies.
const FRESH_PERIODS: u64 = 15;

/// Period of SYNC on the bus.
#[derive(Debug, Clone, Copy)]
pub(crate) struct SyncPeriod {
    pub(crate) cycles: u32,
    pub(crate) ns: u64,
}

/// Plan of an axis. The parts of the axis only read it.
#[derive(Debug)]
pub(crate) struct AxisPlan {
    pub(crate) index: usize,
    pub(crate) config: AxisConfig,
    pub(crate) node: NodeHandle,
    /// CAN ID of the first RPDO.
    pub(crate) rpdo: CanId,
    pub(crate) command_layout: CommandLayout,
    pub(crate) layout: PdoLayout,
    /// The TPDOs carry further objects, or there are RPDOs after the first.
    pub(crate) is_extended: bool,
    /// There are RPDOs after the first.
    pub(crate) has_auxiliary: bool,
    pub(crate) cycles_per_sync: u32,
    /// New images, beyond those of the configuration, that a scheduled target may wait for its phase in the
    /// gateway, and then for its SYNC in the drive.
    pub(crate) schedule_images: u16,
    /// Treatment of an enabled drive at the first contact.
    pub(crate) takeover: Takeover,
    /// Longest age of a present status.
    pub(crate) fresh_ns: u64,
}

impl AxisPlan {
    pub(crate) fn new(
        index: usize,
        config: AxisConfig,
        node: NodeHandle,
        sync: SyncPeriod,
        takeover: Takeover,
    ) -> Self {
        let layout = config.layout();
        Self {
            index,
            node,
            rpdo: config.rpdo_id(0),
            command_layout: layout.command(),
            is_extended: layout.is_extended() || config.scale_source == ScaleSource::Drive,
            has_auxiliary: layout.rpdo_count() > 1,
            layout,
            cycles_per_sync: sync.cycles,
            schedule_images: 0,
            takeover,
            fresh_ns: FRESH_NS.max(sync.ns.saturating_mul(FRESH_PERIODS)),
            config,
        }
    }

    /// Object with the position that a drive keeps at rest: its target in CSP, its demand in PP.
    pub(crate) fn kept_position(&self) -> Option<u16> {
        match self.config.mode {
            OperatingMode::CyclicPosition => Some(object::TARGET_POSITION),
            OperatingMode::ProfilePosition => Some(object::POSITION_DEMAND),
            _ => None,
        }
    }

    /// Error code of the last emergency message of the node; 0 without one.
    pub(crate) fn error_code(&self, network: &Network) -> u16 {
        network.emcy(self.node).map_or(0, ecan_canopen::EmcyLog::last_code)
    }
}

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
