//! Channel status

use ecan_c_boundary::channel_status::igh_mcan_channel_status_t;
use ecan_c_boundary::pointers;
use ecan_c_export::export;
use ecan_protocol::image::ChannelStatus;

/// Decodes a channel status word.
///
/// @param raw     The word of the image header.
/// @param status  Is overwritten.
///
/// @usage   rt, any thread, any time
#[export(call)]
pub fn igh_mcan_channel_status_decode(raw: u16, status: *mut igh_mcan_channel_status_t) {
    pointers!(call, out(status));
    status.set(ChannelStatus::from_raw(raw).into());
}
