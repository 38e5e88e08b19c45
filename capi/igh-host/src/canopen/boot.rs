//! Boot-up of nodes

use std::ffi::{c_char, c_void};

use ecan_c_boundary::pointers;
use ecan_c_boundary::result::ecan_result_t;
use ecan_c_export::export;

use super::boot_report::BootReporter;
use super::boot_terms::{igh_canopen_boot_progress_t, igh_canopen_boot_state_t};
use super::lookup::need_node;
use crate::callback::ProgressCallback;
use crate::cia402::context::igh_cia402_context_t;
use crate::errors::OrCode as _;
use crate::milliseconds::duration;

/// In place of a node in igh_canopen_boot_again(): all nodes that boot.
pub const IGH_CANOPEN_ALL_NODES: usize = 0xFFFF_FFFF;

/// Gets the state of the boot-up of all nodes.
///
/// @param boot_state  Gets an igh_canopen_boot_state_t.
///
/// @usage   rt, the cycle's thread, after init
#[export(_, layer(cia402, _), into boot_state)]
pub fn igh_canopen_get_boot_state(context: *mut igh_cia402_context_t, boot_state: *mut u8) {
    Ok(igh_canopen_boot_state_t::from(cia402.network().boot_state()) as u8)
}

/// Gets the progress of the boot-up of a node. One that does not boot has the phase
/// IGH_CANOPEN_BOOT_PHASE_NONE and zeros.
///
/// @usage   rt, the cycle's thread, after init
/// @return  ECAN_OK, ECAN_ERR_NODE.
#[export(call, layer(cia402, port), into progress)]
pub fn igh_canopen_get_boot_progress(
    context: *mut igh_cia402_context_t,
    node: usize,
    progress: *mut igh_canopen_boot_progress_t,
) {
    let handle = need_node(call, cia402, node)?;
    let now_ns = port.adapter().clock().now_ns();
    let found = cia402.network().boot_progress_of(handle, now_ns);
    Ok(found.map_or_else(igh_canopen_boot_progress_t::none, Into::into))
}

/// Gets the progress of the boot-up of a node as text, with the cause of a failure: "gripper, node 4
/// (slave 0, channel 1): writing parameters, 3 of 17, 0x6081:00 (Profile velocity), for 12 ms" for
/// example. Empty for a node that does not boot.
///
/// @param text  See the rules for texts in igh_ecan_common.h.
///
/// @usage   not rt, the cycle's thread, after init
/// @return  ECAN_OK, ECAN_ERR_BUFFER, ECAN_ERR_NODE.
#[export(call, layer(cia402, port))]
pub fn igh_canopen_get_boot_text(
    context: *mut igh_cia402_context_t,
    node: usize,
    text: *mut c_char,
    size: usize,
    needed: *mut usize,
) {
    pointers!(call, out_text(text, size, needed));
    let handle = need_node(call, cia402, node)?;
    let now_ns = port.adapter().clock().now_ns();
    let progress = cia402.network().boot_progress_of(handle, now_ns);
    text.put(call, &progress.map(|progress| progress.to_string()).unwrap_or_default())
}

/// Sets a function to which igh_canopen_wait_booted_timeout() reports the progress of the nodes: at its
/// start, and on every change of a phase. It runs inside this call, between two cycles; a call to the
/// library with this context returns ECAN_ERR_BUSY there.
///
/// @param callback  Gets `user`, the node, and the text of igh_canopen_get_boot_text(), which is valid
///                  until it returns; NULL for none. It must return, as that of
///                  ecan_igh_stop_waiting_when().
/// @param user      Is passed to it.
///
/// @usage   not rt, the cycle's thread, after init
#[export(_, bus bus)]
pub fn igh_canopen_set_boot_callback(
    context: *mut igh_cia402_context_t,
    callback: Option<
        unsafe extern "C-unwind" fn(user: *mut c_void, node: usize, text: *const c_char),
    >,
    user: *mut c_void,
) {
    if let Some(axes) = bus.axes_mut() {
        axes.boot_progress = callback.map(|function| ProgressCallback {
            function,
            user,
            setter: "igh_canopen_set_boot_callback()",
        });
    }
}

/// Waits until all mandatory nodes are booted. Runs the cycle, with the axes at their last targets. If a
/// node fails, it waits for the end of the other boot-ups of mandatory nodes.
///
/// @param timeout_ms  Milliseconds.
///
/// @usage   not rt, the cycle's thread, active bus
/// @return  ECAN_OK; ECAN_ERR_BOOT, where ecan_last_error() names each mandatory node that is not
///          booted, with its phase or the cause; ECAN_ERR_ATTACHED on a master of another owner, use
///          igh_canopen_get_boot_state() there; ECAN_ERR_ORDER if the bus is not active;
///          ECAN_ERR_STOPPED, ECAN_ERR_MASTER.
#[must_use]
#[export(call, bus bus)]
pub fn igh_canopen_wait_booted_timeout(context: *mut igh_cia402_context_t, timeout_ms: u32) {
    bus.run_to_end(call)?;
    let callback = bus.axes_mut().and_then(|axes| axes.boot_progress);
    let (cia402, port) = bus.need_axes(call)?;
    let mut reporter = BootReporter::new(callback, cia402.network());
    cia402.wait_booted_timeout(port, duration(timeout_ms), |node| reporter.see(node)).or_code(call)
}

/// Boots a node again, with its configured reset: after a change of its parameters by hand, for
/// example. A node that failed boots again automatically only after its boot-up message.
///
/// @param node  The node, or IGH_CANOPEN_ALL_NODES.
///
/// @usage   rt, the cycle's thread, after init
/// @return  ECAN_OK; ECAN_ERR_NODE; ECAN_ERR_ORDER for a node that does not boot.
#[export(call, layer(cia402, port))]
pub fn igh_canopen_boot_again(context: *mut igh_cia402_context_t, node: usize) {
    let now_ns = port.adapter().clock().now_ns();
    if node == IGH_CANOPEN_ALL_NODES {
        for handle in cia402.network().handles() {
            cia402.network_mut().boot_again(handle, now_ns);
        }
        return Ok(());
    }
    let handle = need_node(call, cia402, node)?;
    if cia402.network().boot_progress_of(handle, now_ns).is_none() {
        let text =
            format_args!("node {node} does not boot: its axis configures it, or it was added");
        return Err(call.fail(ecan_result_t::ECAN_ERR_ORDER, text));
    }
    cia402.network_mut().boot_again(handle, now_ns);
}
