//! Acceptance filters (manual 13.4)

use std::ffi::c_int;

use ecan_mcan_host::boundary::{Call, call};
use ecan_mcan_host::common::result::ecan_result_t;
use ecan_protocol::config::{
    ExtendedFilter, ExtendedMatch, FilterAction, StandardFilter, StandardMatch,
};

use ecan_mcan_port::AcceptanceFilter;

use super::config::{IGH_MCAN_MAX_FILTERS, PortPlain, igh_mcan_port_config_t};

/// Which identifiers a filter matches.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum igh_mcan_match_t {
    /// From id1 to id2, both included; extended ones after the channel's global mask.
    IGH_MCAN_MATCH_RANGE = 0,
    /// id1 and id2.
    IGH_MCAN_MATCH_TWO = 1,
    /// Those that equal id1 in the bits set in id2.
    IGH_MCAN_MATCH_MASKED = 2,
    /// Extended filters: from id1 to id2 without the global mask. Standard filters: none.
    IGH_MCAN_MATCH_RANGE_UNMASKED = 3,
}

/// What happens to a frame that a filter matches.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum igh_mcan_filter_action_t {
    /// The filter is out of use.
    IGH_MCAN_FILTER_DISABLED = 0,
    /// Into RX FIFO 0.
    IGH_MCAN_FILTER_FIFO0 = 1,
    /// Into RX FIFO 1.
    IGH_MCAN_FILTER_FIFO1 = 2,
    /// Refused.
    IGH_MCAN_FILTER_REJECT = 3,
    /// Marked as a priority message; it goes where later filters say.
    IGH_MCAN_FILTER_PRIORITY = 4,
    /// Marked as a priority message, into RX FIFO 0.
    IGH_MCAN_FILTER_PRIORITY_FIFO0 = 5,
    /// Marked as a priority message, into RX FIFO 1.
    IGH_MCAN_FILTER_PRIORITY_FIFO1 = 6,
    /// Into the receive buffer whose number is id2; the filter means the one identifier id1.
    IGH_MCAN_FILTER_BUFFER = 7,
}

fn action(call: Call, action: c_int, id2: u32) -> Result<FilterAction, ecan_result_t> {
    let known = u8::try_from(action).ok().and_then(|raw| FilterAction::from_raw(raw, id2));
    known.ok_or_else(|| call.argument("action", format_args!("{action} is not 0 to 7")))
}

fn add(
    call: Call,
    config: &mut PortPlain,
    (slave, channel): (usize, u8),
    filter: AcceptanceFilter,
) -> Result<(), ecan_result_t> {
    config.channel(call, slave, channel)?;
    let Some(place) = config.filters.iter_mut().find(|place| place.is_none()) else {
        let text = format_args!("{IGH_MCAN_MAX_FILTERS} filters are the most");
        return Err(call.fail(ecan_result_t::ECAN_ERR_FULL, text));
    };
    *place = Some((slave as u16, channel, filter));
    Ok(())
}

/// Adds a filter for 11-bit identifiers behind those that the channel has; at most 64.
///
/// What no filter matches is accepted or refused by 0x8001:36 (igh_mcan_port_set_channel_object()).
///
/// @param matching  An igh_mcan_match_t.
/// @param action    An igh_mcan_filter_action_t.
/// @param id1, id2  Identifiers, or identifier and mask.
///
/// @usage   not rt, any thread, before apply
/// @return  ECAN_OK, ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED, ECAN_ERR_SLAVE, ECAN_ERR_CHANNEL,
///          ECAN_ERR_ARGUMENT; ECAN_ERR_FULL beyond IGH_MCAN_MAX_FILTERS.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn igh_mcan_port_add_standard_filter(
    config: *mut igh_mcan_port_config_t,
    slave: usize,
    channel: u8,
    matching: c_int,
    action: c_int,
    id1: u16,
    id2: u16,
) -> c_int {
    call("igh_mcan_port_add_standard_filter", |call| {
        // SAFETY: the pointer is C's, valid or NULL as the header demands.
        let config = unsafe { PortPlain::open(call, config)? };
        let kind = u8::try_from(matching).ok().and_then(StandardMatch::from_raw);
        let matching = kind
            .ok_or_else(|| call.argument("matching", format_args!("{matching} is not 0 to 3")))?;
        let action = self::action(call, action, id2.into())?;
        let filter = StandardFilter { matching, action, sync: false, id1, id2 };
        add(call, config, (slave, channel), AcceptanceFilter::Standard(filter))
    })
}

/// Adds a filter for 29-bit identifiers; as igh_mcan_port_add_standard_filter(), at most 24.
///
/// @usage   not rt, any thread, before apply
/// @return  As there.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn igh_mcan_port_add_extended_filter(
    config: *mut igh_mcan_port_config_t,
    slave: usize,
    channel: u8,
    matching: c_int,
    action: c_int,
    id1: u32,
    id2: u32,
) -> c_int {
    call("igh_mcan_port_add_extended_filter", |call| {
        // SAFETY: the pointer is C's, valid or NULL as the header demands.
        let config = unsafe { PortPlain::open(call, config)? };
        let kind = u8::try_from(matching).ok().and_then(ExtendedMatch::from_raw);
        let matching = kind
            .ok_or_else(|| call.argument("matching", format_args!("{matching} is not 0 to 3")))?;
        let action = self::action(call, action, id2)?;
        let filter = ExtendedFilter { matching, action, sync: false, id1, id2 };
        add(call, config, (slave, channel), AcceptanceFilter::Extended(filter))
    })
}

/// Removes all filters of a channel.
///
/// @usage   not rt, any thread, before apply
/// @return  ECAN_OK, ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED, ECAN_ERR_SLAVE, ECAN_ERR_CHANNEL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn igh_mcan_port_clear_filters(
    config: *mut igh_mcan_port_config_t,
    slave: usize,
    channel: u8,
) -> c_int {
    call("igh_mcan_port_clear_filters", |call| {
        // SAFETY: the pointer is C's, valid or NULL as the header demands.
        let config = unsafe { PortPlain::open(call, config)? };
        config.gateway(call, slave)?.place(call, channel)?;
        let own = |place: &Option<(u16, u8, AcceptanceFilter)>| {
            place.is_some_and(|(s, c, _)| (usize::from(s), c) == (slave, channel))
        };
        // The order of the others stays.
        let mut kept =
            config.filters.iter().filter(|place| !own(place)).copied().collect::<Vec<_>>();
        kept.resize(IGH_MCAN_MAX_FILTERS, None);
        config.filters.copy_from_slice(&kept);
        Ok(())
    })
}
