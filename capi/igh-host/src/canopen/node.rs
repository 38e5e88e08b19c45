//! Nodes of a network and their errors.

use std::ffi::c_int;

use ecan_c_boundary::result::ecan_result_t;
use ecan_c_boundary::{mirror, pointers};
use ecan_c_export::export;
use ecan_canopen::{BootPhase, EmcyRecord, ErrorHistory, HistoryEntry, NodeAddress};

use super::boot::igh_canopen_boot_phase_t;
use crate::callback::duration;
use crate::cia402::context::{add_node, find_node, igh_cia402_context_t, need_node, parse_node_id};
use crate::cia402::numbers;
use crate::cia402::numbers::igh_canopen_nmt_state_t;
use crate::cia402::state::igh_canopen_heartbeat_t;
use crate::errors::OrCode as _;

// Section: Nodes of a network
//
// The network of a context (igh_cia402_context_t) has the drives of its axes, in the order of the axis
// table, then the other nodes of the file of igh_cia402_context_init_file(), then those that
// igh_canopen_add_node() adds. `node` is the index of a node in this order, from 0. A drive with several
// axes is one node: `node` is not the index of an axis then, igh_canopen_find_node() returns it.
//
// The process data of nodes without an axis belong to the application: it reads their TPDOs by
// igh_cia402_process_rx_ex() and sends their RPDOs by igh_mcan_port_send_can(), before
// igh_cia402_send_targets_all(), which sends SYNC.
//
// igh_mcan_port_load_config(&igh_config, &mcan_config, "machine.toml", NULL, 0, NULL);
// ...                                              ecan_igh_init, igh_mcan_port_init, OP
// igh_cia402_context_init_file(&motors, &mcan, "machine.toml", NULL);
// if (igh_canopen_wait_booted_timeout(&motors, 30000) != ECAN_OK) puts(ecan_last_error());
// igh_cia402_start_up_timeout(&motors, 30000);

/// State of a CANopen node.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct igh_canopen_node_state_t {
    /// Boot-up messages.
    pub boot_ups: u32,
    /// Timeouts of its heartbeat or of node guarding.
    pub heartbeat_timeouts: u32,
    /// Responses of node guarding whose toggle bit did not alternate.
    pub guard_toggle_errors: u32,
    /// Responses of node guarding with another NMT state than the last command leads to.
    pub guard_state_errors: u32,
    /// Emergency messages.
    pub emergencies: u32,
    /// Error code of the last emergency message; 0 for none, or after the node reset it.
    pub error_code: u16,
    /// Slave index of the gateway.
    pub slave: u16,
    /// Channel of the gateway.
    pub channel: u8,
    /// Node-ID.
    pub node_id: u8,
    /// An igh_canopen_nmt_state_t: the last one that the node reported.
    pub nmt_state: u8,
    /// An igh_canopen_nmt_state_t to which the last boot-up message or command leads: the only
    /// information about a node without heartbeat.
    pub expected_nmt_state: u8,
    /// An igh_canopen_heartbeat_t: of its heartbeat, or of node guarding.
    pub heartbeat: u8,
    /// An igh_canopen_boot_phase_t.
    pub boot_phase: u8,
    /// Zero; for fields of later versions.
    pub reserved: [u8; 34],
}

/// Returns the number of nodes of the network, drives included.
///
/// @usage   rt, the cycle's thread, after init
/// @return  The number; 0 if there is no context.
#[export(_, layer(cia402, _), or 0)]
pub fn igh_canopen_node_count(context: *mut igh_cia402_context_t) -> usize {
    Ok(cia402.network().handles().len())
}

/// Finds a node by its address.
///
/// @param slave    Slave index of the gateway.
/// @param channel  Channel of the gateway, 0 to 3.
/// @param node_id  Node-ID, 1 to 127.
/// @param node     Gets the node.
///
/// @usage   rt, the cycle's thread, after init
/// @return  ECAN_OK; ECAN_ERR_NODE if the network has no such node; ECAN_ERR_ARGUMENT.
#[export(call, layer(cia402, _))]
pub fn igh_canopen_find_node(
    context: *mut igh_cia402_context_t,
    slave: usize,
    channel: u8,
    node_id: u8,
    node: *mut usize,
) {
    pointers!(call, out(node));
    let address = NodeAddress { slave, channel, node: parse_node_id(call, node_id)? };
    node.set(find_node(call, cia402, address)?.0);
}

/// Adds a node that is neither in the axis table nor in the file, for SDO transfers, NMT, guarding and
/// emergency messages. It does not boot. Its channel gets SYNC and the host's heartbeat from then on.
///
/// @param slave    Slave index of the gateway.
/// @param channel  Channel of the gateway, 0 to 3, enabled.
/// @param node_id  Node-ID, 1 to 127.
/// @param node     Gets the node; may be NULL.
///
/// @usage   not rt, the cycle's thread, after init
/// @return  ECAN_OK; ECAN_ERR_CONFIG if the network has the node already, or the host has its
///          node-ID; ECAN_ERR_ARGUMENT.
#[export(call, bus bus)]
pub fn igh_canopen_add_node(
    context: *mut igh_cia402_context_t,
    slave: usize,
    channel: u8,
    node_id: u8,
    node: *mut usize,
) {
    pointers!(call, optional_out(node));
    let address = NodeAddress { slave, channel, node: parse_node_id(call, node_id)? };
    let config = bus.axes_mut().map(|axes| axes.node).unwrap_or_default();
    let (cia402, port) = bus.need_axes(call)?;
    add_node(call, port, cia402, address, config)?;
    if let Some(node) = node {
        node.set(find_node(call, cia402, address)?.0);
    }
}

/// Gets the state of a node.
///
/// @usage   rt, the cycle's thread, after init
/// @return  ECAN_OK, ECAN_ERR_NODE.
#[export(call, layer(cia402, port), into node_state)]
pub fn igh_canopen_get_node_state(
    context: *mut igh_cia402_context_t,
    node: usize,
    node_state: *mut igh_canopen_node_state_t,
) {
    let handle = need_node(call, cia402, node)?;
    let network = cia402.network();
    let status = network.status(handle).ok_or(ecan_result_t::ECAN_ERR_INTERNAL)?;
    let boot = network.boot_progress_of(handle, port.adapter().clock().now_ns());
    let phase: Option<BootPhase> = boot.map(|boot| boot.phase);
    Ok(igh_canopen_node_state_t {
        boot_ups: status.boot_ups,
        heartbeat_timeouts: status.heartbeat_timeouts,
        guard_toggle_errors: status.guard_errors.toggle,
        guard_state_errors: status.guard_errors.state,
        emergencies: status.emcy_count,
        error_code: status.error_code,
        slave: u16::try_from(status.address.slave).unwrap_or(u16::MAX),
        channel: status.address.channel,
        node_id: status.address.node.get(),
        nmt_state: igh_canopen_nmt_state_t::from(status.nmt_state) as u8,
        expected_nmt_state: igh_canopen_nmt_state_t::from(status.expected_nmt_state) as u8,
        heartbeat: igh_canopen_heartbeat_t::from(status.heartbeat) as u8,
        boot_phase: igh_canopen_boot_phase_t::from(phase) as u8,
        reserved: [0; 34],
    })
}

/// Sends an NMT command to a node, with the next targets. A drive with an axis gets it by
/// igh_cia402_send_nmt(), too.
///
/// @param command  An igh_canopen_nmt_t.
///
/// @usage   rt, the cycle's thread, after init
/// @return  ECAN_OK; ECAN_ERR_CANOPEN if the command queue is full; ECAN_ERR_ARGUMENT, ECAN_ERR_NODE.
#[export(call, layer(cia402, _))]
pub fn igh_canopen_send_nmt(context: *mut igh_cia402_context_t, node: usize, command: c_int) {
    let command = numbers::nmt_command(call, command)?;
    let handle = need_node(call, cia402, node)?;
    cia402.network_mut().nmt(handle, command).or_code(call)
}

// Section: Errors of nodes
//
// Emergency messages since the host runs, and the error history 0x1003 in the node.

/// Emergency messages that are kept per node.
pub const IGH_CANOPEN_MAX_EMERGENCIES: usize = 8;

/// Most entries of an error history.
pub const IGH_CANOPEN_MAX_HISTORY: usize = 254;

mirror! {
    /// An emergency message.
    pub struct igh_canopen_emergency_t from rust: EmcyRecord {
        /// Time of the cycle that received it, on the clock of ecan_igh_now_ns().
        at_ns: u64,
        /// Error code, 0x8611 for example; 0 resets an error.
        code: u16 = rust.emcy.code,
        /// Error register 0x1001.
        error_register: u8 = rust.emcy.register.0,
        /// Bytes of the manufacturer.
        data: [u8; 5] = rust.emcy.manufacturer,
        /// Zero; for fields of later versions.
        reserved: [u64; 2] = [0; 2],
    }
}

mirror! {
    /// An entry of the error history 0x1003.
    pub struct igh_canopen_history_entry_t from rust: HistoryEntry {
        /// Error code, as in the emergency message.
        code: u16,
        /// Additional information of the manufacturer.
        additional: u16,
        /// Zero; for fields of later versions.
        reserved: u32 = 0,
    }
}

/// Gets the last emergency messages of a node, newest first; igh_canopen_get_node_state() has their
/// number since the host runs.
///
/// @param emergencies  Gets the messages that fit.
/// @param capacity     Size of `emergencies`; at most IGH_CANOPEN_MAX_EMERGENCIES messages are kept.
/// @param count        Gets the number of stored messages.
///
/// @usage   rt, the cycle's thread, after init
/// @return  ECAN_OK, ECAN_ERR_NODE.
#[export(call, layer(cia402, _))]
pub fn igh_canopen_get_emergencies(
    context: *mut igh_cia402_context_t,
    node: usize,
    emergencies: *mut igh_canopen_emergency_t,
    capacity: usize,
    count: *mut usize,
) {
    pointers!(call, room(emergencies, capacity), out(count));
    count.set(0);
    let handle = need_node(call, cia402, node)?;
    if let Some(log) = cia402.network().emcy(handle) {
        log.recent().take_while(|record| emergencies.push((*record).into())).for_each(drop);
    }
    count.set(emergencies.count());
}

/// Reads the error history of a node, newest entry first. Runs the cycle, with the axes at their last
/// targets.
///
/// @param entries     Gets the entries that fit.
/// @param capacity    Size of `entries`; a history has at most IGH_CANOPEN_MAX_HISTORY.
/// @param count       Gets the number of entries of the node, even if they do not all fit.
/// @param timeout_ms  Timeout for each of the two parts, number and entries, in milliseconds.
///
/// @usage   not rt, the cycle's thread, active bus
/// @return  ECAN_OK; ECAN_ERR_BUFFER if not all fit; ECAN_ERR_CANOPEN or ECAN_ERR_SDO for a node
///          without the object; ECAN_ERR_TIMEOUT, ECAN_ERR_NODE; ECAN_ERR_ORDER if the bus is not
///          active; ECAN_ERR_ATTACHED on a master of another owner.
#[must_use]
#[export(call, bus bus)]
pub fn igh_canopen_read_error_history(
    context: *mut igh_cia402_context_t,
    node: usize,
    entries: *mut igh_canopen_history_entry_t,
    capacity: usize,
    count: *mut usize,
    timeout_ms: u32,
) {
    pointers!(call, room(entries, capacity), out(count));
    count.set(0);
    bus.run_to_end(call)?;
    let timeout = duration(timeout_ms);
    let (cia402, port) = bus.need_axes(call)?;
    let handle = need_node(call, cia402, node)?;
    let mut read = |limit: usize| {
        let limit = u8::try_from(limit.min(IGH_CANOPEN_MAX_HISTORY)).unwrap_or(u8::MAX);
        let steps = ErrorHistory::steps(limit);
        let configurator = cia402.blocking(port, timeout).execute(handle, steps).or_code(call)?;
        let found = configurator.uploaded(handle, ecan_canopen::object::ERROR_HISTORY, 0);
        let found = usize::try_from(found.unwrap_or(0)).unwrap_or(usize::MAX);
        let entries = ErrorHistory::uploaded(&configurator, handle).unwrap_or_default();
        Ok::<_, ecan_result_t>((found.min(IGH_CANOPEN_MAX_HISTORY), entries))
    };
    let (number, _) = read(0)?;
    // A node aborts reading an entry that it does not have.
    let (number, found) = if number > 0 { read(number.min(capacity))? } else { (0, Vec::new()) };
    count.set(number);
    found.iter().take_while(|entry| entries.push((**entry).into())).for_each(drop);
    if number > capacity {
        let text = format_args!("the history has {number} entries, {capacity} fit");
        return Err(call.fail(ecan_result_t::ECAN_ERR_BUFFER, text));
    }
}

/// Clears the error history of a node.
///
/// @param timeout_ms  Milliseconds.
///
/// @usage   not rt, the cycle's thread, active bus
/// @return  As igh_canopen_read_error_history().
#[must_use]
#[export(call, bus bus)]
pub fn igh_canopen_clear_error_history(
    context: *mut igh_cia402_context_t,
    node: usize,
    timeout_ms: u32,
) {
    bus.run_to_end(call)?;
    let (cia402, port) = bus.need_axes(call)?;
    let handle = need_node(call, cia402, node)?;
    let steps = [ErrorHistory::clearing_step()];
    cia402.blocking(port, duration(timeout_ms)).execute(handle, steps).or_code(call)?;
}
