//! Acceptance filters (manual 13.4)

use std::ffi::c_int;

use ecan_c_boundary::Call;
use ecan_c_boundary::result::ecan_result_t;
use ecan_c_export::export;
use ecan_protocol::config::{
    ExtendedFilter, ExtendedMatch, FilterAction, List, StandardFilter, StandardMatch,
};

use ecan_mcan_port::{AcceptanceFilter, PortConfig};

use super::config::igh_mcan_port_config_t;
use crate::port_config;

/// Match rule of a filter.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum igh_mcan_match_t {
    /// From id1 to id2, both included; extended CAN IDs after the channel's global mask.
    IGH_MCAN_MATCH_RANGE = 0,
    /// id1 and id2.
    IGH_MCAN_MATCH_TWO = 1,
    /// CAN IDs that equal id1 in the bits set in id2.
    IGH_MCAN_MATCH_MASKED = 2,
    /// Extended filters: from id1 to id2 without the global mask. Standard filters: no CAN ID.
    IGH_MCAN_MATCH_RANGE_UNMASKED = 3,
}

/// Action for a frame that a filter matches.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum igh_mcan_filter_action_t {
    /// The filter is disabled.
    IGH_MCAN_FILTER_DISABLED = 0,
    /// Into RX FIFO 0.
    IGH_MCAN_FILTER_FIFO0 = 1,
    /// Into RX FIFO 1.
    IGH_MCAN_FILTER_FIFO1 = 2,
    /// Rejected.
    IGH_MCAN_FILTER_REJECT = 3,
    /// Marked as a priority message; later filters select the buffer.
    IGH_MCAN_FILTER_PRIORITY = 4,
    /// Marked as a priority message, into RX FIFO 0.
    IGH_MCAN_FILTER_PRIORITY_FIFO0 = 5,
    /// Marked as a priority message, into RX FIFO 1.
    IGH_MCAN_FILTER_PRIORITY_FIFO1 = 6,
    /// Into the receive buffer with number id2; the filter matches only id1.
    IGH_MCAN_FILTER_BUFFER = 7,
}

fn action(call: Call, action: c_int, id2: u32) -> Result<FilterAction, ecan_result_t> {
    let known = u8::try_from(action).ok().and_then(|raw| FilterAction::from_raw(raw, id2));
    known.ok_or_else(|| {
        call.argument("action", format_args!("{action} is out of range; allowed: 0 to 7"))
    })
}

fn match_kind<T>(
    call: Call,
    number: c_int,
    from_raw: fn(u8) -> Option<T>,
) -> Result<T, ecan_result_t> {
    u8::try_from(number).ok().and_then(from_raw).ok_or_else(|| {
        call.argument("matching", format_args!("{number} is out of range; allowed: 0 to 3"))
    })
}

fn add(
    call: Call,
    config: &mut PortConfig,
    (slave, channel): (usize, u8),
    filter: impl Into<AcceptanceFilter>,
) -> Result<(), ecan_result_t> {
    port_config::channel(call, config, slave, channel)?;
    config
        .add_filter(slave, channel, filter)
        .map_err(|full| call.fail(ecan_result_t::ECAN_ERR_FULL, format_args!("filters: {full}")))
}

/// Adds a filter for 11-bit CAN IDs after the existing ones of the channel; at most 64.
///
/// 0x8001:36 accepts or rejects frames that no filter matches (igh_mcan_port_set_channel_object()).
///
/// @param matching  An igh_mcan_match_t.
/// @param action    An igh_mcan_filter_action_t.
/// @param id1, id2  CAN IDs, or CAN ID and mask.
///
/// @usage   not rt, any thread, before apply
/// @return  ECAN_OK, ECAN_ERR_SLAVE, ECAN_ERR_CHANNEL, ECAN_ERR_ARGUMENT; ECAN_ERR_FULL beyond
///          IGH_MCAN_MAX_FILTERS.
#[must_use]
#[export(call, config config)]
pub fn igh_mcan_port_add_standard_filter(
    config: *mut igh_mcan_port_config_t,
    slave: usize,
    channel: u8,
    matching: c_int,
    action: c_int,
    id1: u16,
    id2: u16,
) {
    let matching = match_kind(call, matching, StandardMatch::from_raw)?;
    let action = self::action(call, action, id2.into())?;
    let filter = StandardFilter { matching, action, sync: false, id1, id2 };
    add(call, config, (slave, channel), filter)
}

/// Adds a filter for 29-bit CAN IDs; as igh_mcan_port_add_standard_filter(), at most 24.
///
/// @usage   not rt, any thread, before apply
/// @return  As there.
#[must_use]
#[export(call, config config)]
pub fn igh_mcan_port_add_extended_filter(
    config: *mut igh_mcan_port_config_t,
    slave: usize,
    channel: u8,
    matching: c_int,
    action: c_int,
    id1: u32,
    id2: u32,
) {
    let matching = match_kind(call, matching, ExtendedMatch::from_raw)?;
    let action = self::action(call, action, id2)?;
    let filter = ExtendedFilter { matching, action, sync: false, id1, id2 };
    add(call, config, (slave, channel), filter)
}

/// Removes all filters of a channel.
///
/// @usage   not rt, any thread, before apply
#[export(call, config config)]
pub fn igh_mcan_port_clear_filters(config: *mut igh_mcan_port_config_t, slave: usize, channel: u8) {
    port_config::channel_entry(call, config, slave, channel)?;
    let others = config.filters.into_iter().filter(|f| (f.slave, f.channel) != (slave, channel));
    config.filters = List::collect(others).unwrap_or_default();
}
