//! Header fields that the caller of the writer provides.

use super::header::HeaderFlags;
use super::status::ChannelStatus;
use crate::mapping::CHANNELS;

/// Header fields that the caller provides.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct CommitFields {
    /// Flags to set. SEQ_WRAP, TX_RESULT_PRESENT and, with an overflow, OVERFLOW_SAT_VALID are
    /// added if they apply; reserved bits are cleared.
    pub flags: HeaderFlags,
    /// `overflow_sat`.
    pub overflow: u8,
    /// Status of each channel; 0 in RxPDO.
    pub channel_status: [ChannelStatus; CHANNELS],
}
