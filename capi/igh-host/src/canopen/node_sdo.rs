//! SDO transfers with nodes in the cycle
//!
//! For every node of the network. A node has one SDO server: while it boots, or its axis is configured,
//! changes its mode or is homing, a transfer of the application waits. igh_canopen_sdo_upload() and
//! igh_canopen_sdo_download() also wait for the end.

use std::ffi::c_void;

use ecan_c_boundary::pointers;
use ecan_c_export::export;

use super::lookup::need_node;
use crate::cia402::context::igh_cia402_context_t;
use crate::cia402::sdo::{igh_cia402_sdo_state_t, poll, started};

/// Starts reading an object of a node; igh_canopen_sdo_poll() gets the result in later cycles.
///
/// @usage   rt, the cycle's thread, after init
/// @return  ECAN_OK; ECAN_ERR_AXIS_STATE while another transfer with the node is in progress;
///          ECAN_ERR_NODE.
#[must_use]
#[export(call, layer(cia402, _))]
pub fn igh_canopen_sdo_start_upload(
    context: *mut igh_cia402_context_t,
    node: usize,
    index: u16,
    subindex: u8,
) {
    let handle = need_node(call, cia402, node)?;
    started(call, cia402.network_mut().start_upload(handle, index, subindex))
}

/// Starts writing an object of a node, as igh_canopen_sdo_start_upload().
///
/// @param data  The value, little endian, with as many bytes as the object has. Is copied.
/// @param size  Its bytes.
///
/// @usage   rt, the cycle's thread, after init
/// @return  As igh_canopen_sdo_start_upload(); ECAN_ERR_CANOPEN for a value that is longer than
///          igh_cia402_settings_t.sdo_buffer_bytes.
#[must_use]
#[export(call, layer(cia402, _))]
pub fn igh_canopen_sdo_start_download(
    context: *mut igh_cia402_context_t,
    node: usize,
    index: u16,
    subindex: u8,
    data: *const c_void,
    size: usize,
) {
    pointers!(call, bytes(data, size));
    let handle = need_node(call, cia402, node)?;
    started(call, cia402.network_mut().start_download(handle, index, subindex, data))
}

/// Gets the state of the last transfer with a node, as igh_cia402_sdo_poll().
///
/// @param state   Gets an igh_cia402_sdo_state_t.
/// @param data    Gets the value of a finished upload, little endian; may be NULL with size 0.
/// @param size    Bytes of the buffer.
/// @param length  Gets the bytes of the value, even if it does not fit; 0 while there is none.
///
/// @usage   rt, the cycle's thread, after init
/// @return  ECAN_OK, also for a failed transfer, whose reason is in ecan_last_error() and
///          ecan_last_abort_code(); ECAN_ERR_BUFFER, ECAN_ERR_NODE.
#[export(call, layer(cia402, _))]
pub fn igh_canopen_sdo_poll(
    context: *mut igh_cia402_context_t,
    node: usize,
    state: *mut u8,
    data: *mut c_void,
    size: usize,
    length: *mut usize,
) {
    pointers!(call, out(state), byte_room(data, size), out(length));
    length.set(0);
    state.set(igh_cia402_sdo_state_t::IGH_CIA402_SDO_IDLE as u8);
    let handle = need_node(call, cia402, node)?;
    poll(call, cia402.network(), handle, &state, &mut data, &length)
}
