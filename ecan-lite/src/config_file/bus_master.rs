//! The master of a bus in the form of ros2_canopen.

use ecan_canopen::NodeId;

use crate::config_file::located::Located;

/// Values of the master of a bus.
#[derive(Clone, Debug, Default)]
pub(crate) struct MasterSource {
    pub(crate) node: Option<NodeId>,
    pub(crate) sync_period_us: Option<Located<u32>>,
    pub(crate) sync_overflow: Option<Located<u8>>,
    pub(crate) heartbeat_ms: Option<u16>,
    /// Consumer heartbeat time of nodes that watch it, in periods.
    pub(crate) heartbeat_multiplier: Option<f64>,
}
