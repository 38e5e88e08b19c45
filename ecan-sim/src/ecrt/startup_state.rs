//! Steps of the state machine that brings a slave to its requested state.

use ecan_protocol::device::AlState;

use super::pdo::AssignmentWrite;
use super::sdo_transfer::MailboxTransfer;

#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Startup {
    Request(AlState),
    Wait { to: AlState, from: u8, since: u64 },
    ClearRegisters,
    Mailboxes,
    Sdo { at: usize, mailbox: MailboxTransfer },
    Assignment { list: Vec<AssignmentWrite>, at: usize, mailbox: MailboxTransfer },
    Watchdog,
    SyncManagers,
    Fmmus,
    ClockCycle,
    ClockSettle { since: u64 },
    ClockStart,
}

impl Startup {
    pub(crate) const BEGIN: Self = Self::Request(AlState::Init);
}
