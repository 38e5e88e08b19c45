//! Mailbox transfers: their owner, their steps and their duration.

use crate::ecrt::sdo_object::SdoFailure;
use crate::ecrt::slave_config::RequestId;
use crate::ecrt::timing::SDO_NS;

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
