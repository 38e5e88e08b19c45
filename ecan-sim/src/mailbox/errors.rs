//! Mailbox errors: a request did not reach its protocol, or is not one of its services
//! (ETG.1000.4).

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum MailboxError {
    /// The mailbox header has a value that the standard reserves.
    Syntax = 1,
    UnsupportedProtocol = 2,
    InvalidChannel = 3,
    ServiceNotSupported = 4,
    InvalidHeader = 5,
    SizeTooShort = 6,
    /// The length in the header, or that of the response, does not fit the mailbox.
    InvalidSize = 8,
}

impl MailboxError {
    const REPLY: u16 = 1;

    pub(super) fn message(self) -> Vec<u8> {
        let [c0, c1] = Self::REPLY.to_le_bytes();
        let [d0, d1] = (self as u16).to_le_bytes();
        vec![c0, c1, d0, d1]
    }
}
