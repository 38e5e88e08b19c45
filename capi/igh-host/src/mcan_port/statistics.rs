//! Counters and capabilities
//!
//! Counters only grow, and wrap at 2^64.

use std::ffi::c_int;

use ecan_mcan_host::boundary::call;
use ecan_mcan_port::{ChannelStatistics, SlaveStatistics};
use ecan_protocol::device::Capabilities;

use super::context::igh_mcan_port_t;
use super::state::{find_channel, need_slave};
use crate::bus;

/// Counters of one gateway.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default)]
pub struct igh_mcan_statistics_t {
    /// Cycles run since the gateway was in service for the first time.
    pub cycles: u64,
    /// Those of them whose working counter was not complete.
    pub incomplete_cycles: u64,
    /// RxPDO images published with a new sequence.
    pub rxpdo_published: u64,
    /// Cycles in which an image was published again because it may not have arrived.
    pub rxpdo_repeated: u64,
    /// RxPDO images with frames that were given up.
    pub rxpdo_discarded: u64,
    /// TxPDO images with new content.
    pub txpdo_received: u64,
    /// Cycles that brought no new TxPDO image.
    pub txpdo_repeated: u64,
    /// TxPDO images that never arrived, by the gaps in the sequence.
    pub txpdo_lost: u64,
    /// TxPDO images that were being written while they were read.
    pub txpdo_torn: u64,
    /// TxPDO images that the gateway marked as incomplete: frames stayed behind or were lost.
    pub txpdo_incomplete: u64,
    /// TxPDO images of another layout than the configured one.
    pub txpdo_layout_changes: u64,
    /// TxPDO images or packets with a fault: bad CRC, bad header, bad packet.
    pub parse_errors: u64,
    /// Transmit results that match no send.
    pub unmatched_results: u64,
    /// Times that the gateway was verified and taken into service.
    pub sessions: u64,
    /// Times that the gateway was lost while in service.
    pub sessions_lost: u64,
    /// Verifications that failed.
    pub verification_failures: u64,
}

impl From<SlaveStatistics> for igh_mcan_statistics_t {
    fn from(from: SlaveStatistics) -> Self {
        Self {
            cycles: from.cycles,
            incomplete_cycles: from.incomplete_cycles,
            rxpdo_published: from.rxpdo_published,
            rxpdo_repeated: from.rxpdo_repeated,
            rxpdo_discarded: from.rxpdo_discarded,
            txpdo_received: from.txpdo_received,
            txpdo_repeated: from.txpdo_repeated,
            txpdo_lost: from.txpdo_lost,
            txpdo_torn: from.txpdo_torn,
            txpdo_incomplete: from.txpdo_incomplete,
            txpdo_layout_changes: from.txpdo_layout_changes,
            parse_errors: from.parse_errors,
            unmatched_results: from.unmatched_results,
            sessions: from.sessions,
            sessions_lost: from.sessions_lost,
            verification_failures: from.verification_failures,
        }
    }
}

/// Counters of one channel.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default)]
pub struct igh_mcan_channel_statistics_t {
    /// Frames of RxPDO images that were published.
    pub frames_sent: u64,
    /// Frames of images that the gateway took.
    pub frames_delivered: u64,
    /// Frames of images that were given up, by the application or after a lost session.
    pub frames_discarded: u64,
    /// Frames taken out of TxPDO images.
    pub frames_received: u64,
    /// Frames refused because the image was full.
    pub refused_image_full: u64,
    /// Frames refused because the gateway's transmit queue might not hold them.
    pub refused_queue_full: u64,
    /// Frames refused because the channel is bus-off.
    pub refused_bus_off: u64,
    /// Transmit results that reported success: code 0 or 1 (manual 10).
    pub results_ok: u64,
    /// Transmit results that reported a failure.
    pub results_failed: u64,
}

impl From<ChannelStatistics> for igh_mcan_channel_statistics_t {
    fn from(from: ChannelStatistics) -> Self {
        Self {
            frames_sent: from.frames_sent,
            frames_delivered: from.frames_delivered,
            frames_discarded: from.frames_discarded,
            frames_received: from.frames_received,
            refused_image_full: from.refused_image_full,
            refused_queue_full: from.refused_queue_full,
            refused_bus_off: from.refused_bus_off,
            results_ok: from.results_ok,
            results_failed: from.results_failed,
        }
    }
}

/// What a gateway can do (0xF000, manual 13.8), read when the Port was made.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default)]
pub struct igh_mcan_capabilities_t {
    /// :07, :08 Serial number, 0 when not programmed.
    pub serial_number: u64,
    /// :04 Hardware revision, 0 when not programmed.
    pub hardware_revision: u32,
    /// :12 Bit n for encapsulation profile n.
    pub profile_mask: u32,
    /// :16 Features.
    pub features: u32,
    /// :19 Bit 0 FoE, bit 2 persistence, bit 4 access levels.
    pub service_flags: u32,
    /// :24 Tests that 0x8030 offers.
    pub data_path_features: u32,
    /// :25 The same.
    pub diagnostic_features: u32,
    /// :26 Runtime options of 0x8020:05.
    pub runtime_option_mask: u32,
    /// :27 Diagnostic options of 0x8020:06.
    pub diagnostic_option_mask: u32,
    /// :03 Version of the object.
    pub capability_version: u16,
    /// :05 Firmware version: high byte major, low byte minor.
    pub firmware_major: u16,
    /// :06 Firmware build.
    pub firmware_minor: u16,
    /// :09 Bit n for header version n.
    pub header_version_mask: u16,
    /// :13 Greatest PDO of a direction in bytes.
    pub max_pdo_bytes: u16,
    /// :17 Bytes per N.
    pub size_unit_bytes: u16,
    /// :18 Bytes of the fixed header.
    pub header_bytes: u16,
    /// :20 Version of the object extensions.
    pub object_extension: u16,
    /// :21 Version of the data path extensions.
    pub data_path_extension: u16,
    /// :22 Version of the diagnostic extensions.
    pub diagnostic_extension: u16,
    /// :28 Receive cache of a channel in frames.
    pub rx_cache_max: u16,
    /// :29 Transmit cache of a channel in frames.
    pub tx_cache_max: u16,
    /// :30 Upper limit of 0x8020:07 in microseconds.
    pub max_service_budget_us: u16,
    /// :01 0 is ECAN-Lite, others are customised.
    pub device_type: u8,
    /// :02 CAN channels.
    pub channel_count: u8,
    /// :10 Smallest N.
    pub multiplier_min: u8,
    /// :11 Greatest N.
    pub multiplier_max: u8,
    /// :14 Greatest number of channels.
    pub max_channels: u8,
    /// :15 Option flags that can be set.
    pub option_mask: u8,
}

impl From<&Capabilities> for igh_mcan_capabilities_t {
    fn from(from: &Capabilities) -> Self {
        Self {
            serial_number: from.serial_number,
            hardware_revision: from.hardware_revision,
            profile_mask: from.profile_mask,
            features: from.features.0,
            service_flags: from.service_flags,
            data_path_features: from.data_path_features,
            diagnostic_features: from.diagnostic_features,
            runtime_option_mask: from.runtime_option_mask,
            diagnostic_option_mask: from.diagnostic_option_mask,
            capability_version: from.capability_version,
            firmware_major: from.firmware_major,
            firmware_minor: from.firmware_minor,
            header_version_mask: from.header_version_mask,
            max_pdo_bytes: from.max_pdo_bytes,
            size_unit_bytes: from.size_unit_bytes,
            header_bytes: from.header_bytes,
            object_extension: from.object_extension,
            data_path_extension: from.data_path_extension,
            diagnostic_extension: from.diagnostic_extension,
            rx_cache_max: from.rx_cache_max,
            tx_cache_max: from.tx_cache_max,
            max_service_budget_us: from.max_service_budget_us,
            device_type: from.device_type,
            channel_count: from.channel_count,
            multiplier_min: from.multiplier_min,
            multiplier_max: from.multiplier_max,
            max_channels: from.max_channels,
            option_mask: from.option_mask,
        }
    }
}

/// Counters of a gateway.
///
/// @usage   rt, the cycle's thread, after init
/// @return  ECAN_OK, ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED, ECAN_ERR_BUSY, ECAN_ERR_SLAVE.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn igh_mcan_port_get_statistics(
    port: *mut igh_mcan_port_t,
    slave: usize,
    statistics: *mut igh_mcan_statistics_t,
) -> c_int {
    call("igh_mcan_port_get_statistics", |call| {
        // SAFETY: the pointers are C's, valid or NULL as the header demands.
        let (mut bus, out) =
            unsafe { (bus::enter_port(call, port.cast())?, call.out("statistics", statistics)?) };
        let port = bus.need_port(call)?;
        let gateway = need_slave(call, port, slave)?;
        out.set(port.statistics(gateway).into());
        Ok(())
    })
}

/// Counters of a channel.
///
/// @usage   rt, the cycle's thread, after init
/// @return  ECAN_OK, ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED, ECAN_ERR_BUSY, ECAN_ERR_SLAVE,
///          ECAN_ERR_CHANNEL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn igh_mcan_port_get_channel_statistics(
    port: *mut igh_mcan_port_t,
    slave: usize,
    channel: u8,
    statistics: *mut igh_mcan_channel_statistics_t,
) -> c_int {
    call("igh_mcan_port_get_channel_statistics", |call| {
        // SAFETY: the pointers are C's, valid or NULL as the header demands.
        let (mut bus, out) =
            unsafe { (bus::enter_port(call, port.cast())?, call.out("statistics", statistics)?) };
        let port = bus.need_port(call)?;
        let channel = find_channel(call, port, slave, channel)?;
        let statistics =
            channel.map(|at| port.statistics(at.gateway()).channels[usize::from(at.channel())]);
        out.set(statistics.unwrap_or_default().into());
        Ok(())
    })
}

/// What a gateway can do.
///
/// @usage   rt, the cycle's thread, after init
/// @return  ECAN_OK, ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED, ECAN_ERR_BUSY, ECAN_ERR_SLAVE.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn igh_mcan_port_get_capabilities(
    port: *mut igh_mcan_port_t,
    slave: usize,
    capabilities: *mut igh_mcan_capabilities_t,
) -> c_int {
    call("igh_mcan_port_get_capabilities", |call| {
        // SAFETY: the pointers are C's, valid or NULL as the header demands.
        let (mut bus, out) = unsafe {
            (bus::enter_port(call, port.cast())?, call.out("capabilities", capabilities)?)
        };
        let port = bus.need_port(call)?;
        let gateway = need_slave(call, port, slave)?;
        out.set(port.capabilities(gateway).map(Into::into).unwrap_or_default());
        Ok(())
    })
}
