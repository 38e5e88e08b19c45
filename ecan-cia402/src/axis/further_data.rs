//! Process data of an axis beyond controlword, target, statusword and actual position.

use ecan_protocol::can::CanId;

use super::config::AxisConfig;
use super::drive_limits::DriveLimits;
use super::drive_units::{DriveUnits, ScaleFinding};
use super::input_object::{AxisInputs, InputObject};
use super::output_object::OutputValues;
use super::pdo_layout::PdoLayout;
use super::touch_probe::TouchProbes;
use crate::guard::feed_forward::FeedForwardGuard;

/// Further process data of an axis, apart from what every axis needs in every cycle.
#[derive(Debug)]
pub(crate) struct FurtherData {
    pub(crate) layout: PdoLayout,
    /// CAN IDs of the RPDOs after the first.
    pub(crate) auxiliary: Vec<CanId>,
    /// Values of the further objects of the TPDOs.
    pub(crate) inputs: AxisInputs,
    /// Values of the RPDOs after the first.
    pub(crate) outputs: OutputValues,
    pub(crate) feed_forward: FeedForwardGuard,
    /// The drive may have a feed-forward that was sent.
    pub(crate) offsets_in_force: bool,
    /// The drive was in Operation Enabled by its last status.
    pub(crate) was_enabled: bool,
    /// Cycles with a clear path since a frame without feed-forward was sent, that one included.
    pub(crate) cleared_cycles: u32,
    /// The path has no known fault in this cycle. Only with RPDOs after the first.
    pub(crate) is_path_clear: bool,
    pub(crate) probes: TouchProbes,
    /// Limits and units of the drive, as they were read.
    pub(crate) limits: Option<DriveLimits>,
    pub(crate) units: Option<DriveUnits>,
    pub(crate) scale_finding: Option<ScaleFinding>,
    /// The TPDO with the status of the touch probes.
    pub(crate) probe_tpdo: Option<usize>,
}

impl FurtherData {
    pub(crate) fn new(config: &AxisConfig) -> Self {
        let layout = config.layout();
        Self {
            auxiliary: (1..layout.rpdo_count()).map(|nth| config.rpdo_id(nth)).collect(),
            probe_tpdo: layout.tpdo_of(InputObject::ProbeStatus),
            layout,
            inputs: AxisInputs::default(),
            outputs: OutputValues::default(),
            feed_forward: FeedForwardGuard::new(config.feed_forward),
            offsets_in_force: false,
            was_enabled: false,
            cleared_cycles: 0,
            is_path_clear: false,
            probes: TouchProbes::default(),
            limits: None,
            units: None,
            scale_finding: None,
        }
    }
}
