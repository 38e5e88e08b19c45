//! Configuration of a channel (manual 13.4)

use ecan_c_boundary::constants::ECAN_MCAN_CHANNELS;
use ecan_c_boundary::result::ecan_result_t;
use ecan_c_boundary::{Call, pointers};
use ecan_c_export::export;
use ecan_mcan_port::{ChannelConfig, MAX_GATEWAYS, Traffic};
use ecan_protocol::config::{ConfigObject, SamplePointWindow};
use ecan_protocol::mapping::Direction;
use ecan_protocol::object::describe;

use super::config::igh_mcan_port_config_t;
use crate::encoded::EncodedCall as _;
use crate::errors::no_slave;
use crate::port_config::{self, channel_of};

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
    let gateway = port_config::gateway(call, config, slave)?;
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
    let gateway = port_config::gateway(call, config, slave)?;
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
    let entry = port_config::channel_entry(call, config, slave, channel)?;
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
    let entry = port_config::channel_entry(call, config, slave, channel)?;
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
    let can = &mut port_config::channel(call, config, slave, channel)?.can;
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
    let channel = port_config::channel(call, config, slave, channel)?;
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
    let can = &mut port_config::channel(call, config, slave, channel)?.can;
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
    let text = format_args!("{} is not a configuration object", describe(index, subindex));
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
    let data_path = &mut port_config::channel(call, config, slave, channel)?.data_path;
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
