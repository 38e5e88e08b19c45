//! The pace of a mailbox transfer.

use crate::ecrt::master::{MasterModel, Phase};
use crate::ecrt::timing::SDO_NS;

/// A mailbox transfer on its way.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct MailboxTransfer {
    /// When it began.
    pub(crate) since: u64,
    /// Sends of the application before it began.
    sends: u64,
    /// The send whose mailbox check found the answer.
    found: Option<u64>,
}

impl MasterModel {
    /// Begins a transfer.
    pub(crate) fn begin_journey(&self, now: u64) -> MailboxTransfer {
        MailboxTransfer { since: now, sends: self.sends, found: None }
    }

    /// Whether the answer is there; otherwise how long to wait before asking again.
    ///
    /// In the operation phase three datagrams travel with three sends of the application: the
    /// request, the check of the mailbox, which is repeated until the device has answered, and the
    /// fetch. Before it the master sends by itself.
    pub(crate) fn travel(&self, journey: &mut MailboxTransfer, now: u64) -> Result<(), u64> {
        let answer_at = journey.since + SDO_NS;
        if self.phase != Phase::Active {
            return if now >= answer_at { Ok(()) } else { Err(answer_at - now) };
        }
        match journey.found {
            Some(send) if self.sends > send => Ok(()),
            Some(_) => Err(0),
            None => {
                if now >= answer_at && self.sends >= journey.sends + 2 {
                    journey.found = Some(self.sends);
                }
                Err(0)
            }
        }
    }
}
