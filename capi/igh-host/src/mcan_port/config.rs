//! Configuration of a Port, as C holds it: with all gateways that a configuration may have.

use std::ffi::c_int;

use ecan_c_boundary::image::IGH_MCAN_OPTION_TX_RESULT;
use ecan_c_boundary::result::ecan_result_t::ECAN_ERR_CHANNEL;
use ecan_c_boundary::result::{ECAN_MCAN_CHANNELS, ecan_result_t};
use ecan_c_boundary::{Call, image, pointers};
use ecan_c_export::export;
use ecan_mcan_port::{
    AcceptanceFilter, ChannelConfig, GatewayConfig, MAX_FILTERS, MAX_GATEWAYS, PortConfig,
    PortError, Traffic,
};
use ecan_protocol::config::{
    ConfigObject, ExtendedFilter, ExtendedMatch, FilterAction, List, SamplePointWindow,
    StandardFilter, StandardMatch,
};
use ecan_protocol::mapping::Direction;
use ecan_protocol::object::describe;

use crate::adapter::config::{configured_port, ecan_igh_config_t, extended_port};
use crate::encoded::{Encoded, EncodedCall as _};
use crate::errors::{OrCode as _, no_slave};

// Section: Configuration
//
// Plain data: it may be copied and needs no deinit. igh_mcan_port_apply_config() passes it to the
// Adapter's configuration, whose startup SDOs it then determines.

/// Most filters of a configuration, of all channels together.
pub const IGH_MCAN_MAX_FILTERS: usize = 512;

const _: () = assert!(IGH_MCAN_MAX_FILTERS == MAX_FILTERS);

/// Configuration of the gateways. About 40 kilobytes.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct igh_mcan_port_config_t {
    /// Not for the application.
    pub opaque: [u64; 5120],
}

/// Has all gateways that a configuration may have.
impl Encoded for igh_mcan_port_config_t {
    type Value = PortConfig;
    const SEAL: u64 = 0x6d63_616e_5f63_6667;
    const INIT: &'static str = "igh_mcan_port_default_config";
}

/// Fills a configuration: no channel enabled, encapsulation 0, no options, pacing on.
///
/// @param config  Is overwritten.
///
/// @usage   not rt, any thread, any time
#[export(call)]
pub fn igh_mcan_port_default_config(config: *mut igh_mcan_port_config_t) {
    pointers!(call, out(config));
    call.encode(&config, &extended_port(&PortConfig::default()))
}

/// Applies a configuration to the Adapter's: ecan_igh_init() then registers PDO profiles, channel
/// masks, bit rates, filters and budgets as startup SDOs (manual 15.5.2, step 4). Is copied; call
/// it again after a change. Only the gateways of the first slave_count slaves count. Sets N of the slaves
/// for which the application has set none: 3, and 8 with a CAN FD channel (manual 5.2).
///
/// Without this call the gateways keep their last configuration; a Port then verifies that it is
/// the Port's configuration.
///
/// @usage   not rt, any thread, before ecan_igh_init
/// @return  ECAN_OK; ECAN_ERR_CONFIG with every fault in ecan_last_error().
#[export(call, config adapter)]
pub fn igh_mcan_port_apply_config(
    igh_config: *mut ecan_igh_config_t,
    config: *const igh_mcan_port_config_t,
) {
    pointers!(call, encoded(config));
    let port = configured_port(&config, adapter.slave_count);
    adapter.size_slaves(&port);
    let checked = port.check(&adapter.adapter_config());
    checked.map_err(PortError::from).or_code(call)?;
    adapter.port = Some(*config);
}

/// Checks a configuration as a whole against that of the Adapter. igh_mcan_port_apply_config() and
/// igh_mcan_port_init() do it, too.
///
/// @usage   not rt, any thread, any time
/// @return  As igh_mcan_port_apply_config().
#[must_use]
#[export(call)]
pub fn igh_mcan_port_check_config(
    igh_config: *const ecan_igh_config_t,
    config: *const igh_mcan_port_config_t,
) {
    pointers!(call, encoded(igh_config), encoded(config));
    let checked =
        configured_port(&config, igh_config.slave_count).check(&igh_config.adapter_config());
    checked.map_err(PortError::from).or_code(call)
}

// Section: Configuration of a channel (manual 13.4)

/// Bit rates of a channel that only its mask enables: the device's defaults.
const NOMINAL: u32 = 500_000;
const DATA: u32 = 5_000_000;

/// Sets the enabled channels of a gateway, and those of them for CAN FD.
///
/// A channel that was enabled keeps its settings unless it changes between classic CAN and CAN FD;
/// a new one gets 500 kbit/s, with CAN FD and 5 Mbit/s in the data phase.
///
/// @param channel_mask  Channels to enable, bit 0 for channel 0.
/// @param canfd_mask    Those of them for CAN FD.
///
/// @usage   not rt, any thread, before apply
/// @return  ECAN_OK, ECAN_ERR_SLAVE; ECAN_ERR_CHANNEL for channels beyond 3, or CAN FD without the
///          channel.
#[export(call, config config)]
pub fn igh_mcan_port_set_channel_mask(
    config: *mut igh_mcan_port_config_t,
    slave: usize,
    channel_mask: u8,
    canfd_mask: u8,
) {
    let gateway = gateway(call, config, slave)?;
    if channel_mask >> ECAN_MCAN_CHANNELS != 0 || canfd_mask & !channel_mask != 0 {
        let text = format_args!(
            "masks 0x{channel_mask:02X} and 0x{canfd_mask:02X} are invalid; allowed: bits 0 to 3, \
             and CAN FD only for enabled channels"
        );
        return Err(call.fail(ecan_result_t::ECAN_ERR_CHANNEL, text));
    }
    for (channel, entry) in gateway.channels.iter_mut().enumerate() {
        let (is_enabled, is_fd) =
            (channel_mask >> channel & 1 == 1, canfd_mask >> channel & 1 == 1);
        *entry = match *entry {
            _ if !is_enabled => None,
            Some(kept) if kept.can.fd == is_fd => Some(kept),
            _ if is_fd => Some(ChannelConfig::fd(NOMINAL, DATA)),
            _ => Some(ChannelConfig::classic(NOMINAL)),
        };
    }
}

/// Gets the enabled channels of a gateway, and those of them for CAN FD. Their bit rates are
/// objects 19 and 20 (igh_mcan_port_get_channel_object()).
///
/// @param channel_mask  Gets the channels, bit 0 for channel 0.
/// @param canfd_mask    Gets those of them for CAN FD.
///
/// @usage   not rt, any thread, any time
#[export(call)]
pub fn igh_mcan_port_get_channel_mask(
    config: *const igh_mcan_port_config_t,
    slave: usize,
    channel_mask: *mut u8,
    canfd_mask: *mut u8,
) {
    pointers!(call, encoded(config), out(channel_mask), out(canfd_mask));
    let gateway = config.gateways.get(slave);
    let gateway = gateway.ok_or_else(|| no_slave(call, slave, MAX_GATEWAYS))?;
    channel_mask.set(gateway.channel_mask());
    let is_fd = |channel: &Option<ChannelConfig>| channel.is_some_and(|c| c.can.fd);
    canfd_mask.set((0..).zip(&gateway.channels).map(|(bit, c)| u8::from(is_fd(c)) << bit).sum());
}

/// Sets the channel masks of both directions, objects 0x8010:04 and 0x8011:04 (manual 3). A channel
/// in one of them only sends or only receives. Until this call both have all enabled channels;
/// after it, enabling a channel does not add it to a mask.
///
/// @param tx_mask  Channels whose frames the TxPDO carries to the host (they receive), bit 0 for
///                 channel 0.
/// @param rx_mask  Channels that the RxPDO carries frames to (they send).
///
/// @usage   not rt, any thread, before apply
/// @return  ECAN_OK, ECAN_ERR_SLAVE; ECAN_ERR_CHANNEL for an empty mask or channels beyond 3.
///          igh_mcan_port_apply_config() checks that the channels are enabled, and that each enabled
///          channel is in a mask.
#[export(call, config config)]
pub fn igh_mcan_port_set_direction_masks(
    config: *mut igh_mcan_port_config_t,
    slave: usize,
    tx_mask: u8,
    rx_mask: u8,
) {
    let gateway = gateway(call, config, slave)?;
    for (object, mask) in [("0x8010:04", tx_mask), ("0x8011:04", rx_mask)] {
        if mask == 0 || mask >> ECAN_MCAN_CHANNELS != 0 {
            let text = format_args!(
                "channel mask 0x{mask:02X} for {object} is invalid; allowed: 0x01 to 0x0F"
            );
            return Err(call.fail(ecan_result_t::ECAN_ERR_CHANNEL, text));
        }
    }
    *gateway = gateway.with_channel_masks(tx_mask, rx_mask);
}

/// Gets the channel masks of both directions: those set, or the enabled channels.
///
/// @param tx_mask  Gets the channels of the TxPDO, bit 0 for channel 0.
/// @param rx_mask  Gets the channels of the RxPDO.
///
/// @usage   not rt, any thread, any time
#[export(call)]
pub fn igh_mcan_port_get_direction_masks(
    config: *const igh_mcan_port_config_t,
    slave: usize,
    tx_mask: *mut u8,
    rx_mask: *mut u8,
) {
    pointers!(call, encoded(config), out(tx_mask), out(rx_mask));
    let gateway = config.gateways.get(slave);
    let gateway = gateway.ok_or_else(|| no_slave(call, slave, MAX_GATEWAYS))?;
    tx_mask.set(gateway.direction_mask(Direction::TxPdo));
    rx_mask.set(gateway.direction_mask(Direction::RxPdo));
}

/// Enables a channel for classic CAN, with all other settings at their defaults.
///
/// @param bitrate  Bit/s.
///
/// @usage   not rt, any thread, before apply
/// @return  ECAN_OK, ECAN_ERR_SLAVE, ECAN_ERR_CHANNEL. igh_mcan_port_apply_config() checks the bit
///          rate.
#[export(call, config config)]
pub fn igh_mcan_port_set_classic_channel(
    config: *mut igh_mcan_port_config_t,
    slave: usize,
    channel: u8,
    bitrate: u32,
) {
    let entry = channel_entry(call, config, slave, channel)?;
    *entry = Some(ChannelConfig::classic(bitrate));
}

/// Enables a channel for CAN FD with bit rate switch and transmitter delay compensation (manual
/// 14.3), with all other settings at their defaults.
///
/// @param nominal  Bit/s of the arbitration phase.
/// @param data     Bit/s of the data phase.
///
/// @usage   not rt, any thread, before apply
/// @return  As igh_mcan_port_set_classic_channel().
#[export(call, config config)]
pub fn igh_mcan_port_set_canfd_channel(
    config: *mut igh_mcan_port_config_t,
    slave: usize,
    channel: u8,
    nominal: u32,
    data: u32,
) {
    let entry = channel_entry(call, config, slave, channel)?;
    *entry = Some(ChannelConfig::fd(nominal, data));
}

/// Sets the windows from which the firmware selects the sample points. By default one sample point:
/// 87.5 %, or the next smaller one that the bit rate allows (manual 5.4.3).
///
/// @param nominal_min, nominal_max  Arbitration phase, in 0.1 %.
/// @param data_min, data_max        Data phase, in 0.1 %.
///
/// @usage   not rt, any thread, before apply
#[export(call, config config)]
pub fn igh_mcan_port_set_sample_points(
    config: *mut igh_mcan_port_config_t,
    slave: usize,
    channel: u8,
    nominal_min: u16,
    nominal_max: u16,
    data_min: u16,
    data_max: u16,
) {
    let can = &mut enabled_channel(call, config, slave, channel)?.can;
    can.nominal_sample_point = SamplePointWindow { min: nominal_min, max: nominal_max };
    can.data_sample_point = SamplePointWindow { min: data_min, max: data_max };
}

/// Sets the traffic for budgets and Message RAM of a channel (manual 13.2.2); 8 and 8
/// by default.
///
/// @param received  Frames from the bus per cycle; at most 8 are drained.
/// @param sent      Frames to the bus per cycle; at most 8 are served.
///
/// @usage   not rt, any thread, before apply
#[export(call, config config)]
pub fn igh_mcan_port_set_traffic(
    config: *mut igh_mcan_port_config_t,
    slave: usize,
    channel: u8,
    received: u8,
    sent: u8,
) {
    let channel = enabled_channel(call, config, slave, channel)?;
    *channel = channel.with_traffic(Traffic { received, sent });
}

/// Sets a configuration object of a channel, 0x8001..0x8004, by the manual's (decimal) subindex:
/// bit timing mode (7), node mode (8), manual timing (25 to 32), delay compensation (16, 33, 34),
/// Message RAM, timestamps and all others of manual 13.4. Filters have their own functions.
///
/// @param subindex  7 and up.
/// @param value     As for an SDO download.
///
/// @usage   not rt, any thread, before apply
/// @return  ECAN_OK; ECAN_ERR_ARGUMENT for a subindex without configuration or an invalid value;
///          ECAN_ERR_SLAVE, ECAN_ERR_CHANNEL.
#[must_use]
#[export(call, config config)]
pub fn igh_mcan_port_set_channel_object(
    config: *mut igh_mcan_port_config_t,
    slave: usize,
    channel: u8,
    subindex: u8,
    value: u32,
) {
    let can = &mut enabled_channel(call, config, slave, channel)?.can;
    set_object(call, can, 0x8001 + u16::from(channel), subindex, value)
}

/// Gets a configuration object of a channel by its subindex.
///
/// @usage   not rt, any thread, any time
/// @return  As igh_mcan_port_set_channel_object().
#[export(call)]
pub fn igh_mcan_port_get_channel_object(
    config: *const igh_mcan_port_config_t,
    slave: usize,
    channel: u8,
    subindex: u8,
    value: *mut u32,
) {
    pointers!(call, encoded(config), out(value));
    let found = channel_of(call, &config, slave, channel)?.can.value(subindex);
    value.set(found.ok_or_else(|| no_object(call, 0x8001 + u16::from(channel), subindex))?);
}

fn set_object(
    call: Call,
    object: &mut impl ConfigObject,
    index: u16,
    subindex: u8,
    value: u32,
) -> Result<(), ecan_result_t> {
    if object.value(subindex).is_none() {
        return Err(no_object(call, index, subindex));
    }
    object.set_value(subindex, value).map_err(|_| {
        let text = format_args!("invalid value {value} for {}", describe(index, subindex));
        call.fail(ecan_result_t::ECAN_ERR_ARGUMENT, text)
    })
}

#[cold]
fn no_object(call: Call, index: u16, subindex: u8) -> ecan_result_t {
    let object = describe(index, subindex);
    let text = format_args!("{object} is not a configured object");
    call.fail(ecan_result_t::ECAN_ERR_ARGUMENT, text)
}

/// Sets a policy object of a channel's data path, 0x8021..0x8024, by the manual's (decimal)
/// subindex (13.2.2): budgets, caches, overflow and critical-frame policies, bus-off recovery.
///
/// @param subindex  1, 4 to 19.
/// @param value     As for an SDO download.
///
/// @usage   not rt, any thread, before apply
/// @return  As igh_mcan_port_set_channel_object().
#[must_use]
#[export(call, config config)]
pub fn igh_mcan_port_set_data_path_object(
    config: *mut igh_mcan_port_config_t,
    slave: usize,
    channel: u8,
    subindex: u8,
    value: u32,
) {
    let data_path = &mut enabled_channel(call, config, slave, channel)?.data_path;
    set_object(call, data_path, 0x8021 + u16::from(channel), subindex, value)
}

/// Gets a policy object of a channel's data path by its subindex.
///
/// @usage   not rt, any thread, any time
/// @return  As igh_mcan_port_set_channel_object().
#[export(call)]
pub fn igh_mcan_port_get_data_path_object(
    config: *const igh_mcan_port_config_t,
    slave: usize,
    channel: u8,
    subindex: u8,
    value: *mut u32,
) {
    pointers!(call, encoded(config), out(value));
    let found = channel_of(call, &config, slave, channel)?.data_path.value(subindex);
    value.set(found.ok_or_else(|| no_object(call, 0x8021 + u16::from(channel), subindex))?);
}

/// Sets an entry of a configuration object of a gateway by index and (decimal) subindex of the manual:
/// pin rotation and the other entries of 0x8000 (13.3), 0x8001..0x8004, 0x8010:04 to :07 and 0x8011:04
/// to :07 (13.2), 0x8020, 0x8021..0x8024, the diagnostic test 0x8030 (13.2.3) and the access timeout
/// 0xB000:03 (13.7). An entry of 0x8000, 0x8020, 0x8030 or 0xB000 that is never set is not written.
///
/// @param value  As for an SDO download. Its range is checked with the whole configuration.
///
/// @usage   not rt, any thread, before apply
/// @return  ECAN_OK, ECAN_ERR_SLAVE; ECAN_ERR_ARGUMENT for an entry without configuration, of a channel
///          that is not enabled, or an invalid value.
#[must_use]
#[export(call, config config)]
pub fn igh_mcan_port_set_gateway_object(
    config: *mut igh_mcan_port_config_t,
    slave: usize,
    index: u16,
    subindex: u8,
    value: u32,
) {
    gateway(call, config, slave)?.set_object(index, subindex, value).map_err(|_| {
        let entry = describe(index, subindex);
        let text = format_args!(
            "{entry} cannot be {value}: it is not a configuration object of an enabled channel or of \
             the gateway, or has no such value"
        );
        call.fail(ecan_result_t::ECAN_ERR_ARGUMENT, text)
    })
}

/// Gets an entry that igh_mcan_port_set_gateway_object() sets.
///
/// @usage   not rt, any thread, any time
/// @return  As igh_mcan_port_set_gateway_object(); ECAN_ERR_ARGUMENT also for one that was never set.
#[export(call)]
pub fn igh_mcan_port_get_gateway_object(
    config: *const igh_mcan_port_config_t,
    slave: usize,
    index: u16,
    subindex: u8,
    value: *mut u32,
) {
    pointers!(call, encoded(config), out(value));
    let gateway = config.gateways.get(slave).ok_or_else(|| no_slave(call, slave, MAX_GATEWAYS))?;
    let found = gateway.object(index, subindex);
    value.set(found.ok_or_else(|| no_object(call, index, subindex))?);
}

// Section: Acceptance filters (manual 13.4)

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

fn parse_action(call: Call, action: c_int, id2: u32) -> Result<FilterAction, ecan_result_t> {
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
    enabled_channel(call, config, slave, channel)?;
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
    let action = parse_action(call, action, id2.into())?;
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
    let action = parse_action(call, action, id2)?;
    let filter = ExtendedFilter { matching, action, sync: false, id1, id2 };
    add(call, config, (slave, channel), filter)
}

/// Removes all filters of a channel.
///
/// @usage   not rt, any thread, before apply
#[export(call, config config)]
pub fn igh_mcan_port_clear_filters(config: *mut igh_mcan_port_config_t, slave: usize, channel: u8) {
    channel_entry(call, config, slave, channel)?;
    let others = config.filters.into_iter().filter(|f| (f.slave, f.channel) != (slave, channel));
    config.filters = List::collect(others).unwrap_or_default();
}

// Section: Configuration of a gateway

/// Sets the encapsulation profiles: 0x8010:05 and 0x8011:05 (manual 9); 0 by default.
///
/// @param tx_encapsulation  Of the TxPDO, slave to master: an igh_mcan_encapsulation_t. 1 and 5
///                          bring timestamps.
/// @param rx_encapsulation  Of the RxPDO.
///
/// @usage   not rt, any thread, before apply
/// @return  ECAN_OK, ECAN_ERR_SLAVE, ECAN_ERR_ARGUMENT.
#[export(call, config config)]
pub fn igh_mcan_port_set_encapsulation(
    config: *mut igh_mcan_port_config_t,
    slave: usize,
    tx_encapsulation: c_int,
    rx_encapsulation: c_int,
) {
    let gateway = gateway(call, config, slave)?;
    let tx = image::encapsulation(call, tx_encapsulation)?;
    gateway.rx_encapsulation = image::encapsulation(call, rx_encapsulation)?;
    gateway.tx_encapsulation = tx;
}

/// Sets the budget policies of the images: 0x8010:06 and 0x8011:06 (manual 12); balanced by
/// default.
///
/// @param tx_budget, rx_budget  An igh_mcan_budget_t each.
///
/// @usage   not rt, any thread, before apply
/// @return  ECAN_OK, ECAN_ERR_SLAVE, ECAN_ERR_ARGUMENT.
#[export(call, config config)]
pub fn igh_mcan_port_set_budget(
    config: *mut igh_mcan_port_config_t,
    slave: usize,
    tx_budget: c_int,
    rx_budget: c_int,
) {
    let gateway = gateway(call, config, slave)?;
    let tx = image::budget(call, tx_budget)?;
    gateway.rx_budget = image::budget(call, rx_budget)?;
    gateway.tx_budget = tx;
}

/// Sets the options of the images: 0x8010:07 and 0x8011:07 (manual 9.1); none by default.
///
/// @param tx_options  IGH_MCAN_OPTION_ values; _TX_RESULT reports the result of every transmission.
/// @param rx_options  IGH_MCAN_OPTION_ values except _TX_RESULT.
///
/// @usage   not rt, any thread, before apply
/// @return  ECAN_OK, ECAN_ERR_SLAVE, ECAN_ERR_ARGUMENT.
#[export(call, config config)]
pub fn igh_mcan_port_set_options(
    config: *mut igh_mcan_port_config_t,
    slave: usize,
    tx_options: u8,
    rx_options: u8,
) {
    let gateway = gateway(call, config, slave)?;
    let tx = image::options(call, tx_options)?;
    if rx_options & IGH_MCAN_OPTION_TX_RESULT != 0 {
        let text = format_args!("must not have TX_RESULT, an option of the TxPDO");
        return Err(call.argument("rx_options", text));
    }
    gateway.rx_options = image::options(call, rx_options)?;
    gateway.tx_options = tx;
}

/// Enables pacing, which is on by default: frames that would overflow the gateway's transmit queue,
/// or for a channel that is bus-off, are rejected. Without pacing the queue drops them.
///
/// @usage   not rt, any thread, before apply
#[export(call, config config)]
pub fn igh_mcan_port_set_paced(config: *mut igh_mcan_port_config_t, slave: usize, paced: c_int) {
    gateway(call, config, slave)?.paced = paced != 0;
}

/// Sets the limits after which a gateway that was ready counts as lost: nothing is sent until it is
/// verified again.
///
/// @param hold_limit   Consecutive images without confirmed delivery; 10 by default.
/// @param input_limit  Consecutive cycles without a new TxPDO image; 100 by default, 0 for no
///                     limit.
///
/// @usage   not rt, any thread, before apply
#[export(call, config config)]
pub fn igh_mcan_port_set_limits(
    config: *mut igh_mcan_port_config_t,
    slave: usize,
    hold_limit: u16,
    input_limit: u16,
) {
    let gateway = gateway(call, config, slave)?;
    (gateway.hold_limit, gateway.input_limit) = (hold_limit, input_limit);
}

/// Allows the application bypass and the tests of 0x8030, which disconnect the CAN side; otherwise
/// a Port that finds them active does not start.
///
/// @usage   not rt, any thread, before apply
#[export(call, config config)]
pub fn igh_mcan_port_allow_diagnostic_tests(
    config: *mut igh_mcan_port_config_t,
    slave: usize,
    allow: c_int,
) {
    gateway(call, config, slave)?.allow_diagnostic_tests = allow != 0;
}

/// A gateway, to change it.
pub(crate) fn gateway(
    call: Call,
    config: &mut PortConfig,
    slave: usize,
) -> Result<&mut GatewayConfig, ecan_result_t> {
    config.gateways.get_mut(slave).ok_or_else(|| no_slave(call, slave, MAX_GATEWAYS))
}

/// A channel, enabled or not, to change it.
pub(crate) fn channel_entry(
    call: Call,
    config: &mut PortConfig,
    slave: usize,
    channel: u8,
) -> Result<&mut Option<ChannelConfig>, ecan_result_t> {
    gateway(call, config, slave)?.channels.get_mut(usize::from(channel)).ok_or_else(|| {
        let most = ECAN_MCAN_CHANNELS - 1;
        let text = format_args!("channel {channel} is out of range; allowed: 0 to {most}");
        call.fail(ECAN_ERR_CHANNEL, text)
    })
}

/// An enabled channel, to change it.
pub(crate) fn enabled_channel(
    call: Call,
    config: &mut PortConfig,
    slave: usize,
    channel: u8,
) -> Result<&mut ChannelConfig, ecan_result_t> {
    let entry = channel_entry(call, config, slave, channel)?;
    entry.as_mut().ok_or_else(|| reject_disabled(call, slave, channel))
}

pub(crate) fn channel_of(
    call: Call,
    config: &PortConfig,
    slave: usize,
    channel: u8,
) -> Result<&ChannelConfig, ecan_result_t> {
    let gateway = config.gateways.get(slave).ok_or_else(|| no_slave(call, slave, MAX_GATEWAYS))?;
    let entry = gateway.channels.get(usize::from(channel)).and_then(Option::as_ref);
    entry.ok_or_else(|| reject_disabled(call, slave, channel))
}

#[cold]
fn reject_disabled(call: Call, slave: usize, channel: u8) -> ecan_result_t {
    let text = format_args!("channel {channel} of slave {slave} is not enabled");
    call.fail(ECAN_ERR_CHANNEL, text)
}
