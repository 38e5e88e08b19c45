//! State of gateways and channels

use std::ffi::{c_char, c_int};

use ecan_c_boundary::channel_status::igh_mcan_channel_status_t;
use ecan_c_boundary::diagnosis::igh_mcan_pdo_parse_diag_t;
use ecan_c_boundary::result::ecan_result_t;
use ecan_c_boundary::{Call, mirror, pointers};
use ecan_c_export::export;
use ecan_mcan_port::{AddressError, ChannelHandle, GatewayHandle, ImageReport, Port, Session};

use super::context::igh_mcan_port_t;
use crate::adapter::cycle::ecan_igh_domain_report_t;
use crate::errors::{self, OrCode as _};

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
