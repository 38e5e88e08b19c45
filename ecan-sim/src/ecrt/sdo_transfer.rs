//! One SDO transfer: its object, its data and its result.

use ecan_protocol::object::AbortCode;

use crate::ecrt::timing::MAILBOX_TIMEOUT_NS;
use crate::world::World;

/// Failure of a transfer: error number (positive) and abort code, 0 without one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct SdoFailure {
    pub(crate) errno: i32,
    pub(crate) abort_code: u32,
}

impl SdoFailure {
    /// The slave did not respond or is in the wrong state.
    pub(crate) const UNANSWERED: Self = Self { errno: libc::EIO, abort_code: 0 };
    pub(crate) const NO_SLAVE: Self = Self { errno: libc::EINVAL, abort_code: 0 };
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct SdoObject {
    pub(crate) index: u16,
    pub(crate) subindex: u8,
    /// Complete Access: all subindices at once.
    pub(crate) complete: bool,
}

impl SdoObject {
    pub(crate) const fn entry(index: u16, subindex: u8) -> Self {
        Self { index, subindex, complete: false }
    }

    pub(crate) const fn whole(index: u16) -> Self {
        Self { index, subindex: 0, complete: true }
    }
}

pub(crate) enum Payload<'a> {
    Download(&'a [u8]),
    Upload(&'a mut Vec<u8>),
}

pub(crate) enum Attempt {
    Done(Result<(), SdoFailure>),
    Waiting,
}

pub(crate) fn attempt(
    world: &mut World,
    slot: usize,
    present: bool,
    since: u64,
    object: SdoObject,
    payload: Payload<'_>,
) -> Attempt {
    if !present {
        return Attempt::Done(Err(SdoFailure::UNANSWERED));
    }
    let responds =
        world.with_gateway(slot, |gateway, now| gateway.mailbox_answers(now)).unwrap_or(false);
    if !responds {
        if world.now_ns().saturating_sub(since) >= MAILBOX_TIMEOUT_NS {
            return Attempt::Done(Err(SdoFailure::UNANSWERED));
        }
        return Attempt::Waiting;
    }
    let SdoObject { index, subindex, complete } = object;
    let result = world.with_gateway(slot, |gateway, now| match payload {
        Payload::Download(data) if complete => gateway.sdo_download_complete(now, index, 0, data),
        Payload::Download(data) => gateway.sdo_download(now, index, subindex, data),
        // no call of the library uploads a whole object
        Payload::Upload(_) if complete => Err(AbortCode::UNSUPPORTED_ACCESS),
        Payload::Upload(data) => {
            data.clear();
            gateway.sdo_upload(now, index, subindex, data)
        }
    });
    Attempt::Done(match result {
        Some(result) => {
            result.map_err(|abort| SdoFailure { errno: libc::EIO, abort_code: abort.0 })
        }
        None => Err(SdoFailure::UNANSWERED),
    })
}
