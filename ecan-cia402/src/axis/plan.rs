//! Plan of an axis: its configuration, and what follows from that.

use ecan_canopen::{Network, NodeHandle, OperatingMode, object};
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
    /// New images, beyond those of the configuration, that a scheduled target may wait in the
    /// gateway.
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
