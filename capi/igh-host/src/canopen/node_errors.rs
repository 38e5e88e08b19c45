//! Errors of nodes
//!
//! Emergency messages since the host runs, and the error history 0x1003 in the node.

use ecan_c_boundary::result::ecan_result_t;
use ecan_c_boundary::{mirror, pointers};
use ecan_c_export::export;
use ecan_canopen::{EmcyRecord, ErrorHistory, HistoryEntry};

use super::lookup::need_node;
use crate::cia402::context::igh_cia402_context_t;
use crate::errors::OrCode as _;
use crate::milliseconds::duration;

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
        let configurator = cia402.execute_timeout(port, handle, steps, timeout).or_code(call)?;
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
    cia402.execute_timeout(port, handle, steps, duration(timeout_ms)).or_code(call)?;
}
