//! One SDO transfer: its data, its steps and its result.

use ecan_protocol::object::AbortCode;

use crate::ecrt::mailbox::{MailboxStep, MailboxTransfer, Pace};
use crate::ecrt::sdo_object::{SdoFailure, SdoObject};
use crate::ecrt::timing::{MAILBOX_TIMEOUT_NS, STATE_POLL_NS};
use crate::world::{Slot, World};

pub(crate) enum Payload<'a> {
    Download(&'a [u8]),
    Upload(&'a mut Vec<u8>),
}

pub(crate) enum Progress {
    Done(Result<(), SdoFailure>),
    /// To be continued after this time, ns.
    Waiting(u64),
}

/// The slave of a transfer.
#[derive(Clone, Copy)]
pub(crate) struct Receiver {
    pub(crate) slot: Slot,
    pub(crate) is_present: bool,
}

/// Continues a transfer: delivers the request, or fetches the response.
///
/// The slave executes a request when it arrives. If the slave is gone by the fetch, as after a
/// reboot, the response is lost with it.
pub(crate) fn proceed(
    world: &mut World,
    slave: Receiver,
    mailbox: &mut MailboxTransfer,
    pace: Pace,
    object: SdoObject,
    payload: Payload<'_>,
) -> Progress {
    let now = world.now_ns();
    let step = match mailbox.next(now, pace) {
        MailboxStep::Wait(ns) => return Progress::Waiting(ns),
        step => step,
    };
    if !slave.is_present {
        return Progress::Done(Err(SdoFailure::UNANSWERED));
    }
    let responds = world.with_gateway_in(slave.slot, |gateway, now| gateway.mailbox_answers(now));
    if responds != Some(true) {
        return match now.saturating_sub(mailbox.since) >= MAILBOX_TIMEOUT_NS {
            true => Progress::Done(Err(SdoFailure::UNANSWERED)),
            false => Progress::Waiting(STATE_POLL_NS),
        };
    }
    if let MailboxStep::Fetch(response) = step {
        return Progress::Done(response);
    }
    let response = execute(world, slave.slot, object, payload);
    match world.with_gateway_in(slave.slot, |gateway, _| gateway.take_lost_response()) {
        Some(true) => {
            mailbox.respond(now + MAILBOX_TIMEOUT_NS, Err(SdoFailure::UNANSWERED));
        }
        _ => {
            let delay =
                world.with_gateway_in(slave.slot, |gateway, _| gateway.config().mailbox_delay_ns);
            mailbox.respond(now + delay.unwrap_or(0), response);
        }
    }
    match mailbox.next(now, pace) {
        MailboxStep::Wait(ns) => Progress::Waiting(ns),
        _ => Progress::Waiting(0),
    }
}

fn execute(
    world: &mut World,
    slot: Slot,
    object: SdoObject,
    payload: Payload<'_>,
) -> Result<(), SdoFailure> {
    let SdoObject { index, subindex, complete } = object;
    let result = world.with_gateway_in(slot, |gateway, now| match payload {
        Payload::Download(data) if complete => gateway.sdo_download_complete(now, index, 0, data),
        Payload::Download(data) => gateway.sdo_download(now, index, subindex, data),
        // no call of the library uploads a whole object
        Payload::Upload(_) if complete => Err(AbortCode::UNSUPPORTED_ACCESS),
        Payload::Upload(data) => {
            data.clear();
            gateway.sdo_upload(now, index, subindex, data)
        }
    });
    match result {
        Some(result) => {
            result.map_err(|abort| SdoFailure { errno: libc::EIO, abort_code: abort.0 })
        }
        None => Err(SdoFailure::UNANSWERED),
    }
}
