//! Mailbox transfers: their owner and their duration.

use crate::ecrt::slave_config::RequestId;
use crate::ecrt::timing::SDO_NS;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct MailboxTransfer {
    pub(crate) since: u64,
    /// Sends of the application before it began.
    sends: u64,
    /// The send whose mailbox check found the response.
    found: Option<u64>,
}

impl MailboxTransfer {
    pub(crate) fn begin(now: u64, sends: u64) -> Self {
        Self { since: now, sends, found: None }
    }

    /// Whether the response has arrived; otherwise the time to wait before the next check.
    ///
    /// In the operation phase (`sends` is set) three datagrams travel with three sends of the
    /// application: the request, the check of the mailbox, which is repeated until the device has
    /// responded, and the fetch. Before it the master sends on its own.
    pub(crate) fn poll(&mut self, now: u64, sends: Option<u64>) -> Result<(), u64> {
        let response_at = self.since + SDO_NS;
        let Some(sends) = sends else {
            return if now >= response_at { Ok(()) } else { Err(response_at - now) };
        };
        match self.found {
            Some(send) if sends > send => Ok(()),
            Some(_) => Err(0),
            None => {
                if now >= response_at && sends >= self.sends + 2 {
                    self.found = Some(sends);
                }
                Err(0)
            }
        }
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
    fn response_arrives_after_its_time_before_activation() {
        let mut transfer = MailboxTransfer::begin(10, 0);
        assert_eq!(transfer.poll(11, None), Err(SDO_NS - 1));
        assert_eq!(transfer.poll(10 + SDO_NS, None), Ok(()));
    }

    #[test]
    fn active_transfer_takes_three_sends() {
        let mut transfer = MailboxTransfer::begin(0, 5);
        for sends in [6, 7] {
            assert_eq!(transfer.poll(SDO_NS, Some(sends)), Err(0));
        }
        assert_eq!(transfer.poll(SDO_NS, Some(7)), Err(0));
        assert_eq!(transfer.poll(SDO_NS, Some(8)), Ok(()));
    }
}
