//! One cycle with its slaves and axes.

use ecan_cia402::AxisStatus;
use ecan_host::DomainReport;
use ecan_mcan_port::{SessionState, SlaveStatistics};
use ecan_protocol::image::ChannelStatus;
use ecan_protocol::mapping::CHANNELS;

use super::time_histogram::TimeHistogram;
use crate::protocol::CycleState;

#[derive(Debug)]
pub(crate) struct CycleSample {
    pub(crate) state: CycleState,
    pub(crate) run_time: TimeHistogram,
    pub(crate) late: TimeHistogram,
    pub(crate) slaves: Vec<SlaveSample>,
    pub(crate) axes: Vec<AxisStatus>,
}

#[derive(Debug)]
pub(crate) struct SlaveSample {
    pub(crate) session: SessionState,
    pub(crate) report: DomainReport,
    pub(crate) statistics: SlaveStatistics,
    /// Of the enabled channels.
    pub(crate) channels: [Option<ChannelStatus>; CHANNELS],
}
