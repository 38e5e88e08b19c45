//! Frames to send

use std::ffi::c_int;

use ecan_c_boundary::frames::{
    check_hint, classic_frame_at, fd_frame, igh_mcan_rx_frame_t, igh_mcan_rx_kind_t,
    igh_mcan_tx_frame_t,
};
use ecan_c_boundary::result::ecan_result_t;
use ecan_c_boundary::{Call, pointers};
use ecan_c_export::export;
use ecan_protocol::mapping::CHANNELS;

/// Checks a slave index and a channel for a frame.
fn slave_of(call: Call, slave: usize, channel: u8) -> Result<u16, ecan_result_t> {
    if usize::from(channel) >= CHANNELS {
        let text =
            format_args!("channel {channel} is out of range; allowed: 0 to {}", CHANNELS - 1);
        return Err(call.fail(ecan_result_t::ECAN_ERR_CHANNEL, text));
    }
    u16::try_from(slave).map_err(|_| {
        let text = format_args!("slave index {slave} is out of range");
        call.fail(ecan_result_t::ECAN_ERR_SLAVE, text)
    })
}

/// Fills a classic CAN frame that is sent at once.
///
/// @param frame    Is overwritten.
/// @param slave    Slave index.
/// @param channel  Channel of the gateway, 0 to 3.
/// @param can_id   11 bits; 29 bits with IGH_MCAN_FLAG_EXT.
/// @param flags    0, IGH_MCAN_FLAG_EXT, IGH_MCAN_FLAG_RTR.
/// @param data     Data; may be NULL if len is 0 and for a remote frame.
/// @param len      Bytes, 0 to 8; of a remote frame the requested DLC.
///
/// @usage   rt, any thread, any time
/// @return  ECAN_OK, ECAN_ERR_SLAVE, ECAN_ERR_CHANNEL or ECAN_ERR_FRAME; the frame is written only
///          with ECAN_OK.
#[export(call)]
pub fn igh_mcan_tx_frame_set_can(
    frame: *mut igh_mcan_tx_frame_t,
    slave: usize,
    channel: u8,
    can_id: u32,
    flags: u8,
    data: *const u8,
    len: usize,
) {
    pointers!(call, out(frame));
    // SAFETY: the data are C's, valid or NULL as the header demands.
    let can = unsafe { classic_frame_at(call, can_id, flags, data, len)? };
    frame.set(igh_mcan_tx_frame_t::from_frame(slave_of(call, slave, channel)?, channel, can));
}

/// Fills a CAN FD frame that is sent at once.
///
/// @param flags  0, IGH_MCAN_FLAG_EXT, IGH_MCAN_FLAG_BRS, IGH_MCAN_FLAG_ESI; IGH_MCAN_FLAG_FD is
///               accepted.
/// @param len    Bytes: 0 to 8, 12, 16, 20, 24, 32, 48 or 64 (manual 8.2).
///
/// @usage   rt, any thread, any time
/// @return  As igh_mcan_tx_frame_set_can().
#[export(call)]
pub fn igh_mcan_tx_frame_set_canfd(
    frame: *mut igh_mcan_tx_frame_t,
    slave: usize,
    channel: u8,
    can_id: u32,
    flags: u8,
    data: *const u8,
    len: usize,
) {
    pointers!(call, out(frame), items(data, len));
    let fd = fd_frame(call, can_id, flags, data)?;
    frame.set(igh_mcan_tx_frame_t::from_frame(slave_of(call, slave, channel)?, channel, fd));
}

/// Fills a frame to send from a received one, as an echo or a bridge does, for the slave and
/// channel that received it.
///
/// @param frame     Is overwritten.
/// @param received  A frame, not a TX_RESULT.
///
/// @usage   rt, any thread, any time
/// @return  ECAN_OK, ECAN_ERR_CHANNEL, or ECAN_ERR_FRAME if it is not a frame.
#[export(call)]
pub fn igh_mcan_tx_frame_set_received(
    frame: *mut igh_mcan_tx_frame_t,
    received: *const igh_mcan_rx_frame_t,
) {
    pointers!(call, out(frame), read(received));
    if received.kind != igh_mcan_rx_kind_t::IGH_MCAN_RX_FRAME as u8 {
        let text = format_args!("`received` is a TX_RESULT, not a frame");
        return Err(call.fail(ecan_result_t::ECAN_ERR_FRAME, text));
    }
    let igh_mcan_rx_frame_t { slave, channel, flags, can_id, len, data, .. } = *received;
    slave_of(call, slave.into(), channel)?;
    let empty = igh_mcan_tx_frame_t::EMPTY;
    let value = igh_mcan_tx_frame_t { slave, channel, flags, can_id, len, data, ..empty };
    value.frame(call)?;
    frame.set(value);
}

/// Schedules a frame for a phase of the next Sync0 period instead of at once (manual 8.4).
///
/// @param offset_ns  Phase, in nanoseconds, below the Sync0 period.
/// @param tag        Tag of the application.
///
/// @usage   rt, any thread, any time
#[export(call)]
pub fn igh_mcan_tx_frame_set_schedule(frame: *mut igh_mcan_tx_frame_t, offset_ns: u32, tag: u16) {
    pointers!(call, change(frame));
    (frame.scheduled, frame.offset_ns, frame.tag) = (1, offset_ns, tag);
}

/// Sets the hint for the gateway's transmit path (manual 8.1).
///
/// @param hint  An igh_mcan_hint_t.
///
/// @usage   rt, any thread, any time
/// @return  ECAN_OK, ECAN_ERR_ARGUMENT.
#[export(call)]
pub fn igh_mcan_tx_frame_set_hint(frame: *mut igh_mcan_tx_frame_t, hint: c_int) {
    pointers!(call, change(frame));
    frame.hint = check_hint(call, hint)?;
}
