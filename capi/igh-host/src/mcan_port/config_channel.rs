//! Configuration of a channel (manual 13.4)

use std::ffi::c_int;

use ecan_mcan_host::boundary::call;
use ecan_mcan_host::common::constants::ECAN_MCAN_CHANNELS;
use ecan_mcan_host::common::result::ecan_result_t;
use ecan_mcan_port::{ChannelConfig, Traffic};
use ecan_protocol::config::{ConfigObject, SamplePointWindow};
use ecan_protocol::object::describe;

use super::config::{ChannelPlain, PortPlain, igh_mcan_port_config_t};

/// Bit rates of a channel that is enabled by its mask alone: the device's defaults.
const NOMINAL: u32 = 500_000;
const DATA: u32 = 5_000_000;

/// Says which channels of a gateway are enabled, and which of them for CAN FD.
///
/// A channel that was enabled keeps its settings as far as its kind stays; a new one gets 500
/// kbit/s, with CAN FD and 5 Mbit/s in the data phase.
///
/// @param channel_mask  Channels to enable, bit 0 for channel 0.
/// @param canfd_mask    Those of them for CAN FD.
///
/// @usage   not rt, any thread, before apply
/// @return  ECAN_OK, ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED, ECAN_ERR_SLAVE; ECAN_ERR_CHANNEL for
///          channels beyond 3, or CAN FD without the channel.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn igh_mcan_port_set_channel_mask(
    config: *mut igh_mcan_port_config_t,
    slave: usize,
    channel_mask: u8,
    canfd_mask: u8,
) -> c_int {
    call("igh_mcan_port_set_channel_mask", |call| {
        // SAFETY: the pointer is C's, valid or NULL as the header demands.
        let gateway = unsafe { PortPlain::open(call, config)? }.gateway(call, slave)?;
        if channel_mask >> ECAN_MCAN_CHANNELS != 0 || canfd_mask & !channel_mask != 0 {
            let text = format_args!(
                "masks 0x{channel_mask:02X} and 0x{canfd_mask:02X}: only the bits 0 to 3, and CAN \
                 FD only of channels that are enabled"
            );
            return Err(call.fail(ecan_result_t::ECAN_ERR_CHANNEL, text));
        }
        for (channel, place) in gateway.channels.iter_mut().enumerate() {
            let (is_enabled, is_fd) =
                (channel_mask >> channel & 1 == 1, canfd_mask >> channel & 1 == 1);
            *place = match *place {
                _ if !is_enabled => None,
                Some(kept) if kept.can.fd == is_fd => Some(kept),
                _ if is_fd => Some((&ChannelConfig::fd(NOMINAL, DATA)).into()),
                _ => Some((&ChannelConfig::classic(NOMINAL)).into()),
            };
        }
        Ok(())
    })
}

/// Gets which channels of a gateway are enabled, and which of them for CAN FD. Their bit rates are
/// objects 19 and 20 (igh_mcan_port_get_channel_object()).
///
/// @param channel_mask  Gets the channels, bit 0 for channel 0.
/// @param canfd_mask    Gets those of them for CAN FD.
///
/// @usage   not rt, any thread, any time
/// @return  ECAN_OK, ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED, ECAN_ERR_SLAVE.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn igh_mcan_port_get_channel_mask(
    config: *const igh_mcan_port_config_t,
    slave: usize,
    channel_mask: *mut u8,
    canfd_mask: *mut u8,
) -> c_int {
    call("igh_mcan_port_get_channel_mask", |call| {
        // SAFETY: the pointers are C's, valid or NULL as the header demands.
        let (config, enabled_out, fd_out) = unsafe {
            (
                PortPlain::read(call, config)?,
                call.out("channel_mask", channel_mask)?,
                call.out("canfd_mask", canfd_mask)?,
            )
        };
        let (mut enabled, mut fd) = (0, 0);
        for (bit, channel) in config.gateway_of(call, slave)?.channels.iter().enumerate() {
            enabled |= u8::from(channel.is_some()) << bit;
            fd |= u8::from(channel.is_some_and(|channel| channel.can.fd)) << bit;
        }
        enabled_out.set(enabled);
        fd_out.set(fd);
        Ok(())
    })
}

/// Enables a channel for classic CAN, with everything else at its default.
///
/// @param bitrate  Bit/s.
///
/// @usage   not rt, any thread, before apply
/// @return  ECAN_OK, ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED, ECAN_ERR_SLAVE, ECAN_ERR_CHANNEL.
///          Whether the bit rate can be had is told by igh_mcan_port_apply_config().
#[unsafe(no_mangle)]
pub unsafe extern "C" fn igh_mcan_port_set_classic_channel(
    config: *mut igh_mcan_port_config_t,
    slave: usize,
    channel: u8,
    bitrate: u32,
) -> c_int {
    call("igh_mcan_port_set_classic_channel", |call| {
        // SAFETY: the pointer is C's, valid or NULL as the header demands.
        let gateway = unsafe { PortPlain::open(call, config)? }.gateway(call, slave)?;
        *gateway.place(call, channel)? = Some((&ChannelConfig::classic(bitrate)).into());
        Ok(())
    })
}

/// Enables a channel for CAN FD with bit rate switch and transmitter delay compensation (manual
/// 14.3), with everything else at its default.
///
/// @param nominal  Bit/s of the arbitration phase.
/// @param data     Bit/s of the data phase.
///
/// @usage   not rt, any thread, before apply
/// @return  As igh_mcan_port_set_classic_channel().
#[unsafe(no_mangle)]
pub unsafe extern "C" fn igh_mcan_port_set_canfd_channel(
    config: *mut igh_mcan_port_config_t,
    slave: usize,
    channel: u8,
    nominal: u32,
    data: u32,
) -> c_int {
    call("igh_mcan_port_set_canfd_channel", |call| {
        // SAFETY: the pointer is C's, valid or NULL as the header demands.
        let gateway = unsafe { PortPlain::open(call, config)? }.gateway(call, slave)?;
        *gateway.place(call, channel)? = Some((&ChannelConfig::fd(nominal, data)).into());
        Ok(())
    })
}

/// Sets the windows in which the firmware may choose the sample points; 75 to 87.5 % by default.
///
/// @param nominal_min, nominal_max  Arbitration phase, in 0.1 %.
/// @param data_min, data_max        Data phase, in 0.1 %.
///
/// @usage   not rt, any thread, before apply
/// @return  ECAN_OK, ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED, ECAN_ERR_SLAVE, ECAN_ERR_CHANNEL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn igh_mcan_port_set_sample_points(
    config: *mut igh_mcan_port_config_t,
    slave: usize,
    channel: u8,
    nominal_min: u16,
    nominal_max: u16,
    data_min: u16,
    data_max: u16,
) -> c_int {
    call("igh_mcan_port_set_sample_points", |call| {
        // SAFETY: the pointer is C's, valid or NULL as the header demands.
        let channel = unsafe { PortPlain::open(call, config)? }.channel(call, slave, channel)?;
        channel.can.nominal_sample_point = SamplePointWindow { min: nominal_min, max: nominal_max };
        channel.can.data_sample_point = SamplePointWindow { min: data_min, max: data_max };
        Ok(())
    })
}

/// Sets the traffic that budgets and Message RAM of a channel are made for (manual 13.2.2); 8 and 8
/// by default.
///
/// @param received  Frames from the bus per cycle; at most 8 are drained.
/// @param sent      Frames to the bus per cycle; at most 8 are served.
///
/// @usage   not rt, any thread, before apply
/// @return  ECAN_OK, ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED, ECAN_ERR_SLAVE, ECAN_ERR_CHANNEL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn igh_mcan_port_set_traffic(
    config: *mut igh_mcan_port_config_t,
    slave: usize,
    channel: u8,
    received: u8,
    sent: u8,
) -> c_int {
    call("igh_mcan_port_set_traffic", |call| {
        // SAFETY: the pointer is C's, valid or NULL as the header demands.
        let channel = unsafe { PortPlain::open(call, config)? }.channel(call, slave, channel)?;
        let ChannelPlain { can, data_path, .. } = *channel;
        let settings = ChannelConfig { can, data_path, ..ChannelConfig::classic(NOMINAL) };
        *channel = (&settings.with_traffic(Traffic { received, sent })).into();
        Ok(())
    })
}

/// Sets any configuration object of a channel, 0x8001..0x8004, by the manual's (decimal) subindex:
/// bit timing mode (7), node mode (8), manual timing (25 to 32), delay compensation (16, 33, 34),
/// Message RAM, timestamps and all others of manual 13.4. Filters have functions of their own.
///
/// @param subindex  7 and up.
/// @param value     As it would be written by SDO.
///
/// @usage   not rt, any thread, before apply
/// @return  ECAN_OK; ECAN_ERR_ARGUMENT for a subindex that is no configuration or a value that it
///          does not have; ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED, ECAN_ERR_SLAVE,
///          ECAN_ERR_CHANNEL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn igh_mcan_port_set_channel_object(
    config: *mut igh_mcan_port_config_t,
    slave: usize,
    channel: u8,
    subindex: u8,
    value: u32,
) -> c_int {
    call("igh_mcan_port_set_channel_object", |call| {
        // SAFETY: the pointer is C's, valid or NULL as the header demands.
        let channel = unsafe { PortPlain::open(call, config)? }.channel(call, slave, channel)?;
        let set = channel.can.set_value(subindex, value);
        set.map_err(|fault| call.fail(ecan_result_t::ECAN_ERR_ARGUMENT, format_args!("{fault}")))
    })
}

/// Gets a configuration object of a channel by its subindex.
///
/// @usage   not rt, any thread, any time
/// @return  As igh_mcan_port_set_channel_object().
#[unsafe(no_mangle)]
pub unsafe extern "C" fn igh_mcan_port_get_channel_object(
    config: *const igh_mcan_port_config_t,
    slave: usize,
    channel: u8,
    subindex: u8,
    value: *mut u32,
) -> c_int {
    call("igh_mcan_port_get_channel_object", |call| {
        // SAFETY: the pointers are C's, valid or NULL as the header demands.
        let (config, out) = unsafe { (PortPlain::read(call, config)?, call.out("value", value)?) };
        let value = config.channel_of(call, slave, channel)?.can.value(subindex);
        out.set(value.ok_or_else(|| no_object(call, 0x8001 + u16::from(channel), subindex))?);
        Ok(())
    })
}

#[cold]
fn no_object(call: ecan_mcan_host::boundary::Call, index: u16, subindex: u8) -> ecan_result_t {
    let text = format_args!("{} is no configuration", describe(index, subindex));
    call.fail(ecan_result_t::ECAN_ERR_ARGUMENT, text)
}

/// Sets any policy object of a channel's data path, 0x8021..0x8024, by the manual's (decimal)
/// subindex (13.2.2): budgets, caches, overflow and critical-frame policies, bus-off recovery.
///
/// @param subindex  1, 4 to 19.
/// @param value     As it would be written by SDO.
///
/// @usage   not rt, any thread, before apply
/// @return  As igh_mcan_port_set_channel_object().
#[unsafe(no_mangle)]
pub unsafe extern "C" fn igh_mcan_port_set_data_path_object(
    config: *mut igh_mcan_port_config_t,
    slave: usize,
    channel: u8,
    subindex: u8,
    value: u32,
) -> c_int {
    call("igh_mcan_port_set_data_path_object", |call| {
        // SAFETY: the pointer is C's, valid or NULL as the header demands.
        let settings = unsafe { PortPlain::open(call, config)? }.channel(call, slave, channel)?;
        let index = 0x8021 + u16::from(channel);
        if settings.data_path.value(subindex).is_none() {
            return Err(no_object(call, index, subindex));
        }
        settings.data_path.set_value(subindex, value).map_err(|_| {
            let text = format_args!("invalid value {value} for {}", describe(index, subindex));
            call.fail(ecan_result_t::ECAN_ERR_ARGUMENT, text)
        })?;
        Ok(())
    })
}

/// Gets a policy object of a channel's data path by its subindex.
///
/// @usage   not rt, any thread, any time
/// @return  As igh_mcan_port_set_channel_object().
#[unsafe(no_mangle)]
pub unsafe extern "C" fn igh_mcan_port_get_data_path_object(
    config: *const igh_mcan_port_config_t,
    slave: usize,
    channel: u8,
    subindex: u8,
    value: *mut u32,
) -> c_int {
    call("igh_mcan_port_get_data_path_object", |call| {
        // SAFETY: the pointers are C's, valid or NULL as the header demands.
        let (config, out) = unsafe { (PortPlain::read(call, config)?, call.out("value", value)?) };
        let value = config.channel_of(call, slave, channel)?.data_path.value(subindex);
        out.set(value.ok_or_else(|| no_object(call, 0x8021 + u16::from(channel), subindex))?);
        Ok(())
    })
}
