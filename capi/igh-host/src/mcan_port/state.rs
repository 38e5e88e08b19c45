//! State, counters and capabilities of gateways and channels.

use std::ffi::{c_char, c_int};

use ecan_c_boundary::image::{igh_mcan_channel_status_t, igh_mcan_pdo_parse_diag_t};
use ecan_c_boundary::result::ecan_result_t;
use ecan_c_boundary::{Call, mirror, pointers};
use ecan_c_export::export;
use ecan_mcan_port::{
    AddressError, ChannelHandle, ChannelStatistics, GatewayHandle, ImageReport, Port, Session,
    SlaveStatistics, check_delivery,
};
use ecan_protocol::device::Capabilities;

use super::context::igh_mcan_port_t;
use crate::adapter::cycle::ecan_igh_domain_report_t;
use crate::errors;
use crate::errors::OrCode as _;

// Section: State of gateways and channels

mirror! {
    /// State of a gateway's session.
    pub enum igh_mcan_session_t from Session {
        /// The slave is not in OP, or its process data are missing.
        IGH_MCAN_SESSION_WAITING = 0 => Session::Waiting,
        /// In OP, being verified; only empty images are sent.
        IGH_MCAN_SESSION_VERIFYING = 1 => Session::Verifying,
        /// Ready.
        IGH_MCAN_SESSION_READY = 2 => Session::Ready,
        /// Verification failed; it starts again every second.
        IGH_MCAN_SESSION_FAILED = 3 => Session::Failed(_),
    }
}

mirror! {
    /// Kind of the TxPDO image of a cycle.
    pub enum igh_mcan_image_t from ImageReport {
        /// The gateway is not ready.
        IGH_MCAN_IMAGE_NONE = 0 => ImageReport::None,
        /// A new image.
        IGH_MCAN_IMAGE_NEW = 1 => ImageReport::New { .. },
        /// The image of an earlier cycle again.
        IGH_MCAN_IMAGE_REPEATED = 2 => ImageReport::Repeated,
        /// An image with a fault, usable up to the fault at most; see
        /// igh_mcan_port_get_parse_diag().
        IGH_MCAN_IMAGE_FAULT = 3 => ImageReport::Fault(_),
    }
}

/// One cycle with one gateway.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct igh_mcan_cycle_report_t {
    /// Working counter and delivery.
    pub domain: ecan_igh_domain_report_t,
    /// An igh_mcan_image_t.
    pub image: u8,
    /// 1 if the gateway marked the image as incomplete (manual 6.1).
    pub is_incomplete: u8,
    /// 1 if the image's layout is not the configured one: its frames may be misread.
    pub layout_changed: u8,
    /// 1 if the last RxPDO image is unconfirmed and is repeated; frames sent now wait.
    pub is_unconfirmed: u8,
    /// Images lost before this one, by the sequence.
    pub lost_images: u16,
    /// Zero; for fields of later versions.
    pub reserved: [u16; 13],
}

pub(crate) fn need_slave(
    call: Call,
    port: &Port,
    slave: usize,
) -> Result<GatewayHandle, ecan_result_t> {
    port.gateway(slave).or_code(call)
}

/// Returns the state of a gateway's session.
///
/// @usage   rt, the cycle's thread, after init
/// @return  An igh_mcan_session_t; ECAN_ERR_SLAVE.
#[export(call, layer port)]
pub fn igh_mcan_port_get_session(port: *mut igh_mcan_port_t, slave: usize) -> c_int {
    let gateway = need_slave(call, port, slave)?;
    Ok(igh_mcan_session_t::from(port.session(gateway)) as c_int)
}

/// Gets the state of a gateway's session as text, with the reason of a failure and the pending step.
///
/// @param text  See the rules for texts in igh_ecan_common.h.
///
/// @usage   not rt, the cycle's thread, after init
/// @return  ECAN_OK, ECAN_ERR_SLAVE, ECAN_ERR_BUFFER.
#[export(call, bus bus)]
pub fn igh_mcan_port_get_session_text(
    port: *mut igh_mcan_port_t,
    slave: usize,
    text: *mut c_char,
    size: usize,
    needed: *mut usize,
) {
    pointers!(call, out_text(text, size, needed));
    let port = bus.need_port(call)?;
    let gateway = need_slave(call, port, slave)?;
    let session = port.session(gateway);
    let description = match port.waiting_for(gateway) {
        Some(step) => format!("{session}; it waits for {step}"),
        None => session.to_string(),
    };
    text.put(call, &description)
}

/// Gets a change of a gateway or channel that was not told yet, as a line: what was lost, why as far as it is
/// known, what returned and after how long, with the time since ecan_open() or ecan_igh_wait_op_timeout(). Call it
/// after each cycle until the text is empty.
///
/// @param text  Empty if there is none. A call with size 0 leaves the change for the next call. See the rules for texts in igh_ecan_common.h.
///
/// @usage   not rt, the cycle's thread, after init
/// @return  ECAN_OK; ECAN_ERR_BUFFER for a line that is cut.
#[export(call, bus bus)]
pub fn igh_mcan_port_next_change(
    port: *mut igh_mcan_port_t,
    text: *mut c_char,
    size: usize,
    needed: *mut usize,
) {
    pointers!(call, out_text(text, size, needed));
    let change = bus.next_change(size == 0);
    text.put(call, &change.map_or_else(String::new, |change| change.to_string()))
}

/// Fails at the end of a program that sends if no frame was delivered, or if a channel is bus-off or rejects frames
/// while its condition is not good.
///
/// @usage   rt, the cycle's thread, after init
/// @return  ECAN_OK; ECAN_ERR_NOT_READY with the reason, as far as it is known.
#[must_use]
#[export(call, layer port)]
pub fn igh_mcan_port_check_delivery(port: *mut igh_mcan_port_t) {
    check_delivery(port)
        .map_err(|error| call.fail(ecan_result_t::ECAN_ERR_NOT_READY, format_args!("{error}")))
}

/// Gets the report of the current cycle with a gateway.
///
/// @usage   rt, the cycle's thread, after init
#[export(call, layer port, into report)]
pub fn igh_mcan_port_get_cycle_report(
    port: *mut igh_mcan_port_t,
    slave: usize,
    report: *mut igh_mcan_cycle_report_t,
) {
    let gateway = need_slave(call, port, slave)?;
    let report = port.cycle_report(gateway);
    let (lost_images, is_incomplete, layout_changed) = match report.image {
        ImageReport::New { lost, is_incomplete, layout_changed } => {
            (lost, is_incomplete, layout_changed)
        }
        _ => (0, false, false),
    };
    Ok(igh_mcan_cycle_report_t {
        domain: report.domain.into(),
        image: igh_mcan_image_t::from(report.image) as u8,
        is_incomplete: is_incomplete.into(),
        layout_changed: layout_changed.into(),
        is_unconfirmed: report.is_unconfirmed.into(),
        lost_images,
        reserved: [0; 13],
    })
}

/// Gets the last fault in a TxPDO image (manual 16.2).
///
/// @param diag  Gets the fault; error 0 for none.
///
/// @usage   rt, the cycle's thread, after init
#[export(call, layer port, into diag)]
pub fn igh_mcan_port_get_parse_diag(
    port: *mut igh_mcan_port_t,
    slave: usize,
    diag: *mut igh_mcan_pdo_parse_diag_t,
) {
    let gateway = need_slave(call, port, slave)?;
    Ok(port.last_diagnosis(gateway).as_ref().map(Into::into).unwrap_or_default())
}

/// Gets the status of a channel from the last TxPDO image (manual 7); all 0 before the first.
///
/// @usage   rt, the cycle's thread, after init
#[export(call, layer port, into status)]
pub fn igh_mcan_port_get_channel_status(
    port: *mut igh_mcan_port_t,
    slave: usize,
    channel: u8,
    status: *mut igh_mcan_channel_status_t,
) {
    let channel = find_channel(call, port, slave, channel)?;
    let status = channel.map(|channel| port.channel_status(channel)).unwrap_or_default();
    Ok(status.into())
}

/// The channel, or `None` for one that is not enabled.
pub(crate) fn find_channel(
    call: Call,
    port: &Port,
    slave: usize,
    channel: u8,
) -> Result<Option<ChannelHandle>, ecan_result_t> {
    match port.channel(slave, channel) {
        Ok(channel) => Ok(Some(channel)),
        Err(AddressError::Disabled { .. }) => Ok(None),
        Err(error) => Err(errors::note(call, &error)),
    }
}

// Section: Counters and capabilities
//
// Counters only grow, and wrap at 2^64. Each accepted frame is in exactly one column:
// frames_accepted is the sum of frames_delivered, frames_lost, frames_discarded, frames_unknown and
// frames_pending. Images read from the gateway since it was ready for the first time are
// txpdo_received, txpdo_lost and txpdo_discarded, and at most txpdo_unknown more; the number of
// frames in lost and unknown images cannot be known.

mirror! {
    /// Counters of one gateway.
    #[derive(Default)]
    pub struct igh_mcan_statistics_t from rust: SlaveStatistics {
        /// Cycles since the gateway was ready for the first time.
        cycles: u64,
        /// Cycles among them with an incomplete working counter.
        incomplete_cycles: u64,
        /// RxPDO images published with a new sequence.
        rxpdo_published: u64,
        /// Cycles in which an unconfirmed image was repeated.
        rxpdo_repeated: u64,
        /// RxPDO images with frames that were withdrawn before their delivery was confirmed.
        rxpdo_discarded: u64,
        /// TxPDO images with new content.
        txpdo_received: u64,
        /// Cycles without a new TxPDO image.
        txpdo_repeated: u64,
        /// Lost or damaged TxPDO images, by the gaps in the sequence.
        txpdo_lost: u64,
        /// TxPDO images that were being written while they were read.
        txpdo_torn: u64,
        /// TxPDO images that the gateway marked as incomplete: frames were delayed or lost.
        txpdo_incomplete: u64,
        /// TxPDO images of another layout than the configured one.
        txpdo_layout_changes: u64,
        /// TxPDO images or packets with a fault: bad CRC, bad header, bad packet.
        parse_errors: u64,
        /// Transmit results without a matching frame.
        unmatched_results: u64,
        /// Times that the gateway became ready.
        sessions: u64,
        /// Times that the gateway was lost while ready; a loss during its verification is none.
        sessions_lost: u64,
        /// Failed verifications.
        verification_failures: u64,
        /// TxPDO images that arrived while the gateway was not ready; their frames are not handed
        /// out.
        txpdo_discarded: u64,
        /// Most TxPDO images that can have been lost in outages after which the gateway started its
        /// sequence again.
        txpdo_unknown: u64,
        /// Requests of another startup because the gateway stayed in one state below OP.
        startup_requests: u64,
        /// Zero; for fields of later versions.
        reserved: [u64; 9] = [0; 9],
    }
}

mirror! {
    /// Counters of one channel.
    #[derive(Default)]
    pub struct igh_mcan_channel_statistics_t from rust: ChannelStatistics {
        /// Frames of RxPDO images that were published.
        frames_sent: u64,
        /// Frames that the gateway took in OP.
        frames_delivered: u64,
        /// Frames that never left the host: discarded by the application or after a lost session, or
        /// withdrawn because their phase had passed.
        frames_discarded: u64,
        /// Frames received in TxPDO images.
        frames_received: u64,
        /// Frames rejected because the image was full.
        rejected_image_full: u64 = rust.rejected_image_full,
        /// Frames rejected because the gateway's transmit queue might overflow.
        rejected_queue_full: u64 = rust.rejected_queue_full,
        /// Frames rejected because the channel was bus-off.
        rejected_bus_off: u64 = rust.rejected_bus_off,
        /// Transmit results that reported success: code 0 or 1 (manual 10).
        results_ok: u64,
        /// Transmit results that reported a failure.
        results_failed: u64,
        /// Frames that a send accepted.
        frames_accepted: u64,
        /// Frames of published images that the gateway certainly did not take.
        frames_lost: u64,
        /// Frames that the gateway may have taken: of images whose delivery is not known, or that it
        /// may have taken outside OP.
        frames_unknown: u64,
        /// Frames without a known result so far; not a counter.
        frames_pending: u64,
        /// Frames of images that the slave controller took, by the working counter: of those that are
        /// delivered, pending or unknown.
        frames_confirmed: u64,
        /// Frames that arrived and that the application did not take: left in their cycle, or while
        /// the gateway was not ready.
        frames_not_taken: u64,
        /// Zero; for fields of later versions.
        reserved: [u64; 9] = [0; 9],
    }
}

mirror! {
    /// Capabilities of a gateway (0xF000, manual 13.8), read when the Port was opened.
    #[derive(Default)]
    pub struct igh_mcan_capabilities_t from rust: &Capabilities {
        /// :07, :08 Serial number, 0 when not programmed.
        serial_number: u64,
        /// :04 Hardware revision, 0 when not programmed.
        hardware_revision: u32,
        /// :12 Bit n for encapsulation profile n.
        profile_mask: u32,
        /// :16 Features.
        features: u32 = rust.features.0,
        /// :19 Bit 0 FoE, bit 2 persistence, bit 4 access levels.
        service_flags: u32,
        /// :24 Tests that 0x8030 offers.
        data_path_features: u32,
        /// :25 The same.
        diagnostic_features: u32,
        /// :26 Runtime options of 0x8020:05.
        runtime_option_mask: u32,
        /// :27 Diagnostic options of 0x8020:06.
        diagnostic_option_mask: u32,
        /// :03 Version of the object.
        capability_version: u16,
        /// :05 Firmware version: high byte major, low byte minor.
        firmware_major: u16,
        /// :06 Firmware build.
        firmware_minor: u16,
        /// :09 Bit n for header version n.
        header_version_mask: u16,
        /// :13 Maximum PDO size of a direction in bytes.
        max_pdo_bytes: u16,
        /// :17 Bytes per N.
        size_unit_bytes: u16,
        /// :18 Bytes of the fixed header.
        header_bytes: u16,
        /// :20 Version of the object extensions.
        object_extension: u16,
        /// :21 Version of the data path extensions.
        data_path_extension: u16,
        /// :22 Version of the diagnostic extensions.
        diagnostic_extension: u16,
        /// :28 Receive cache of a channel in frames.
        rx_cache_max: u16,
        /// :29 Transmit cache of a channel in frames.
        tx_cache_max: u16,
        /// :30 Upper limit of 0x8020:07 in microseconds.
        max_service_budget_us: u16,
        /// :01 0 is ECAN-Lite, others are customised.
        device_type: u8,
        /// :02 CAN channels.
        channel_count: u8,
        /// :10 Minimum N.
        multiplier_min: u8,
        /// :11 Maximum N.
        multiplier_max: u8,
        /// :14 Maximum number of channels.
        max_channels: u8,
        /// :15 Option flags that can be set.
        option_mask: u8,
        /// Zero; for fields of later versions.
        reserved: [u64; 7] = [0; 7],
    }
}

/// Gets the counters of a gateway.
///
/// @usage   rt, the cycle's thread, after init
#[export(call, layer port, into statistics)]
pub fn igh_mcan_port_get_statistics(
    port: *mut igh_mcan_port_t,
    slave: usize,
    statistics: *mut igh_mcan_statistics_t,
) {
    let gateway = need_slave(call, port, slave)?;
    Ok(port.statistics(gateway).into())
}

/// Gets the counters of a channel.
///
/// @usage   rt, the cycle's thread, after init
#[export(call, layer port, into statistics)]
pub fn igh_mcan_port_get_channel_statistics(
    port: *mut igh_mcan_port_t,
    slave: usize,
    channel: u8,
    statistics: *mut igh_mcan_channel_statistics_t,
) {
    let channel = find_channel(call, port, slave, channel)?;
    let statistics =
        channel.map(|at| port.statistics(at.gateway()).channels[usize::from(at.channel())]);
    Ok(statistics.unwrap_or_default().into())
}

/// Gets the capabilities of a gateway.
///
/// @usage   rt, the cycle's thread, after init
#[export(call, layer port, into capabilities)]
pub fn igh_mcan_port_get_capabilities(
    port: *mut igh_mcan_port_t,
    slave: usize,
    capabilities: *mut igh_mcan_capabilities_t,
) {
    let gateway = need_slave(call, port, slave)?;
    Ok(port.capabilities(gateway).map(Into::into).unwrap_or_default())
}
