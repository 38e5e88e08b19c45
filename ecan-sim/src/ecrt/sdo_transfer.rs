//! One SDO transfer: its object, its owner, its steps with their duration, and its result.

use ecan_protocol::object::AbortCode;

use super::timing::{MAILBOX_TIMEOUT_NS, SDO_NS, STATE_POLL_NS};
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
    match world.with_gateway_in(slave.slot, |gateway, _| gateway.parts().1.take_lost_response()) {
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
        Payload::Download(data) if complete => {
            gateway.objects(now).download_complete(index, 0, data)
        }
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

/// Failure of a transfer: error number (positive) and abort code, 0 without one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct SdoFailure {
    pub(crate) errno: i32,
    pub(crate) abort_code: u32,
}

impl SdoFailure {
    /// The slave did not respond or is in the wrong state.
    pub(crate) const UNANSWERED: Self = Self { errno: libc::EIO, abort_code: 0 };
    /// The SII of the slave has no CoE.
    pub(crate) const NO_COE: Self = Self { errno: libc::EPROTONOSUPPORT, abort_code: 0 };
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

/// Steps of a transfer before activation: request, mailbox check, fetch, result.
const IDLE_STEPS: u64 = 4;

/// Pace of the state machines of the master.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Pace {
    /// Before activation: one step in this time, ns. The master sends on its own.
    Timed(u64),
    /// In the operation phase the datagrams travel with the application's sends: steps so far.
    Sends(u64),
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct MailboxTransfer {
    pub(crate) since: u64,
    /// Steps of the master before it began.
    steps: u64,
    /// Result of the request, in the mailbox of the slave from its time on until it is fetched.
    response: Option<(u64, Result<(), SdoFailure>)>,
    /// The step whose mailbox check found the response.
    found: Option<u64>,
}

/// Next step of a transfer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum MailboxStep {
    /// Nothing for this time, ns.
    Wait(u64),
    /// The request reaches the slave.
    Deliver,
    /// The response is fetched.
    Fetch(Result<(), SdoFailure>),
}

impl MailboxTransfer {
    pub(crate) fn begin(now: u64, steps: u64) -> Self {
        Self { since: now, steps, response: None, found: None }
    }

    /// The slave has executed the request; its response is in its mailbox at `ready_at`.
    pub(crate) fn respond(&mut self, ready_at: u64, response: Result<(), SdoFailure>) {
        self.response = Some((ready_at, response));
    }

    /// The next step.
    ///
    /// Three datagrams are exchanged: the request, the check of the mailbox, which is repeated until
    /// the device has responded, and the fetch.
    pub(crate) fn next(&mut self, now: u64, pace: Pace) -> MailboxStep {
        match pace {
            Pace::Timed(step_ns) => {
                let (step, due) = match self.response {
                    None => (MailboxStep::Deliver, self.since + step_ns),
                    Some((ready_at, response)) => {
                        let fetched = self.since + IDLE_STEPS * step_ns;
                        (MailboxStep::Fetch(response), fetched.max(ready_at))
                    }
                };
                if now >= due { step } else { MailboxStep::Wait(due - now) }
            }
            Pace::Sends(steps) => self.next_by_sends(now, steps),
        }
    }

    fn next_by_sends(&mut self, now: u64, steps: u64) -> MailboxStep {
        let Some((ready_at, response)) = self.response else {
            let is_sent = steps > self.steps;
            return if is_sent { MailboxStep::Deliver } else { MailboxStep::Wait(0) };
        };
        match self.found {
            Some(found) if steps > found => return MailboxStep::Fetch(response),
            None if now >= ready_at.max(self.since + SDO_NS) && steps >= self.steps + 2 => {
                self.found = Some(steps);
            }
            _ => {}
        }
        MailboxStep::Wait(0)
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct RequestId {
    pub(crate) config: usize,
    pub(crate) request: usize,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum TransferOwner {
    Blocking(u64),
    Request(RequestId),
    Register(RequestId),
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Transfer {
    pub(crate) owner: TransferOwner,
    pub(crate) mailbox: MailboxTransfer,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn transfer_before_activation_takes_four_steps() {
        let (mut transfer, pace) = (MailboxTransfer::begin(10, 0), Pace::Timed(500));
        assert_eq!(transfer.next(11, pace), MailboxStep::Wait(499));
        assert_eq!(transfer.next(510, pace), MailboxStep::Deliver);
        transfer.respond(510, Ok(()));
        assert_eq!(transfer.next(510, pace), MailboxStep::Wait(1_500));
        assert_eq!(transfer.next(2_010, pace), MailboxStep::Fetch(Ok(())));
    }

    #[test]
    fn active_transfer_takes_three_steps() {
        let mut transfer = MailboxTransfer::begin(0, 5);
        assert_eq!(transfer.next(SDO_NS, Pace::Sends(5)), MailboxStep::Wait(0));
        assert_eq!(transfer.next(SDO_NS, Pace::Sends(6)), MailboxStep::Deliver);
        transfer.respond(0, Ok(()));
        let steps = [6, 7, 7, 8].map(|steps| transfer.next(SDO_NS, Pace::Sends(steps)));
        let wait = MailboxStep::Wait(0);
        assert_eq!(steps, [wait, wait, wait, MailboxStep::Fetch(Ok(()))]);
    }
}
