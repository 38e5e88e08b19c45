//! Boot-up of nodes
//!
//! The nodes of a file that have no axis boot as CiA 302-2 specifies: reset, response, identity, default
//! parameters, parameters with readback, PDOs, heartbeat, start. All nodes of all channels boot in parallel,
//! from the first cycle on; the cycle executes the boot-ups. A node that fails does not stop the others.
//! A node that restarts, or is replaced, boots again automatically.

use std::ffi::{c_char, c_void};

use ecan_c_boundary::result::ecan_result_t;
use ecan_c_boundary::{mirror, pointers};
use ecan_c_export::export;
use ecan_canopen::{BootPhase, BootProgress, BootState};

use crate::callback::{ProgressCallback, duration};
use crate::cia402::context::{igh_cia402_context_t, need_node};
use crate::errors::OrCode as _;

mirror! {
    /// State of the boot-up of all nodes.
    pub enum igh_canopen_boot_state_t from BootState {
        /// A mandatory node is not booted yet.
        IGH_CANOPEN_BOOT_RUNNING = 0 => BootState::Running,
        /// All mandatory nodes are booted, also without any. Optional nodes may still boot, or have
        /// failed.
        IGH_CANOPEN_BOOT_DONE = 1 => BootState::Booted,
        /// A mandatory node failed.
        IGH_CANOPEN_BOOT_FAILED = 2 => BootState::Failed,
    }
}

mirror! {
    /// Phase of the boot-up of a node.
    pub enum igh_canopen_boot_phase_t from Option<BootPhase> {
        /// The node does not boot: its axis configures it, or the node was added without a boot-up.
        IGH_CANOPEN_BOOT_PHASE_NONE = 0 => None,
        /// Nodes that boot before are not booted yet.
        IGH_CANOPEN_BOOT_PHASE_WAITING = 1 => Some(BootPhase::Waiting),
        /// The node has not responded yet.
        IGH_CANOPEN_BOOT_PHASE_CONTACT = 2 => Some(BootPhase::Contact),
        /// Device type, identity and software are compared.
        IGH_CANOPEN_BOOT_PHASE_IDENTITY = 3 => Some(BootPhase::Identity),
        /// The default parameters are restored.
        IGH_CANOPEN_BOOT_PHASE_RESTORE = 4 => Some(BootPhase::Restore),
        /// Parameters are written and read back.
        IGH_CANOPEN_BOOT_PHASE_PARAMETERS = 5 => Some(BootPhase::Parameters),
        /// PDOs are mapped.
        IGH_CANOPEN_BOOT_PHASE_PDOS = 6 => Some(BootPhase::Steps),
        /// The heartbeat is configured, and the node started.
        IGH_CANOPEN_BOOT_PHASE_START = 7 => Some(BootPhase::Start),
        /// The node has its parameters and runs as configured.
        IGH_CANOPEN_BOOT_PHASE_BOOTED = 8 => Some(BootPhase::Booted),
        /// The boot-up of the node failed; see `status` and igh_canopen_get_boot_text().
        IGH_CANOPEN_BOOT_PHASE_FAILED = 9 => Some(BootPhase::Failed),
    }
}

mirror! {
    /// Progress of the boot-up of a node.
    pub struct igh_canopen_boot_progress_t from rust: BootProgress {
        /// Time since the boot-up began, or its duration if it has ended, in milliseconds.
        elapsed_ms: u64 = u64::try_from(rust.elapsed.as_millis()).unwrap_or(u64::MAX),
        /// Written parameters.
        done: u32 = count(rust.done),
        /// Parameters to write.
        of: u32 = count(rust.of),
        /// Boot-ups after a restart of the node.
        restarts: u32,
        /// Object whose transfer is in progress; 0 for none.
        index: u16 = rust.subject.as_ref().map_or(0, |subject| subject.index),
        /// Its subindex.
        subindex: u8 = rust.subject.as_ref().map_or(0, |subject| subject.subindex),
        /// An igh_canopen_boot_phase_t.
        phase: u8 = igh_canopen_boot_phase_t::from(Some(rust.phase)) as u8,
        /// Error status of CiA 302-2, a letter from 'A' to 'O'; 0 while there is none. 'B': no
        /// response; 'C', 'D', 'M', 'N', 'O': device type, vendor-ID, product code, revision number,
        /// serial number; 'H': software; 'J': parameters or PDOs; 'K': start.
        status: u8 = rust.error.as_ref().map_or(0, |error| error.cia302_status() as u8),
        /// 1 if the network is booted only with this node.
        is_mandatory: u8,
        /// 1 if the node had its parameters already, by its configuration date 0x1020.
        is_unchanged: u8,
        /// Zero; for fields of later versions.
        reserved: [u8; 37] = [0; 37],
    }
}

fn count(number: usize) -> u32 {
    u32::try_from(number).unwrap_or(u32::MAX)
}

impl igh_canopen_boot_progress_t {
    /// Of a node that does not boot.
    pub(super) fn none() -> Self {
        Self {
            elapsed_ms: 0,
            done: 0,
            of: 0,
            restarts: 0,
            index: 0,
            subindex: 0,
            phase: igh_canopen_boot_phase_t::IGH_CANOPEN_BOOT_PHASE_NONE as u8,
            status: 0,
            is_mandatory: 0,
            is_unchanged: 0,
            reserved: [0; 37],
        }
    }
}

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
    let network = cia402.network();
    let nodes: Vec<_> = network.handles().map(|handle| network.address(handle)).collect();
    let mut waiting = cia402.blocking(port, duration(timeout_ms));
    let booted = waiting.wait_booted(|progress| {
        let node = nodes.iter().position(|address| *address == Some(progress.address));
        if let (Some(callback), Some(node)) = (callback, node) {
            callback.report(node, progress);
        }
    });
    booted.or_code(call)
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
