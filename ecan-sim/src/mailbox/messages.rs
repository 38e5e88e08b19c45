//! Messages of the mailboxes: headers (ETG.1000.4, CoE), errors, queue of responses, and the context of a request.

use std::collections::VecDeque;

use ecan_protocol::object::AbortCode;

use crate::gateway::variant::GatewayVariant;
use crate::gateway::{Gateway, ObjectAccess};

pub(super) const HEADER_BYTES: usize = 6;

pub(super) mod protocol {
    pub(in crate::mailbox) const ERROR: u8 = 0;
    pub(in crate::mailbox) const COE: u8 = 3;
    pub(in crate::mailbox) const FOE: u8 = 4;
    /// Undefined protocol numbers.
    pub(in crate::mailbox) const RESERVED: std::ops::RangeInclusive<u8> = 6..=14;
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Header {
    /// Length of the message after the header.
    pub(super) length: u16,
    /// Station address of the source or of the destination.
    pub(super) address: u16,
    /// Channel, 0 to 63; only 0 exists.
    pub(super) channel: u8,
    pub(super) protocol: u8,
    /// Counter of the message, 1 to 7; 0 is none.
    pub(super) counter: u8,
}

impl Header {
    /// Parses a header; also returns the bytes after it. `None` if there are too few.
    pub(super) fn parse(buffer: &[u8]) -> Option<(Self, &[u8])> {
        let (&[l0, l1, a0, a1, channel, kind], rest) = buffer.split_first_chunk()?;
        let header = Self {
            length: u16::from_le_bytes([l0, l1]),
            address: u16::from_le_bytes([a0, a1]),
            channel: channel & 0x3F,
            protocol: kind & 0x0F,
            counter: kind >> 4 & 0x07,
        };
        Some((header, rest))
    }

    /// The header in bytes, with the lowest priority.
    pub(super) fn to_bytes(self) -> [u8; HEADER_BYTES] {
        let [l0, l1] = self.length.to_le_bytes();
        let [a0, a1] = self.address.to_le_bytes();
        let kind = self.protocol & 0x0F | (self.counter & 0x07) << 4;
        [l0, l1, a0, a1, self.channel & 0x3F, kind]
    }
}

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

/// Size of the queue; a response of several fragments counts once.
const KEPT: usize = 8;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct MessageAddress {
    /// Station address of the requester.
    pub(super) address: u16,
    pub(super) protocol: u8,
}

#[derive(Clone, Debug)]
struct Answer {
    ready: u64,
    to: MessageAddress,
    /// Never empty.
    messages: VecDeque<Vec<u8>>,
}

/// Messages for the read mailbox.
#[derive(Clone, Debug, Default)]
pub(super) struct ResponseQueue {
    answers: VecDeque<Answer>,
    counter: u8,
}

impl ResponseQueue {
    pub(super) fn is_full(&self) -> bool {
        self.answers.len() >= KEPT
    }

    /// Adds a response that becomes ready at `ready`; the messages are without mailbox header. A
    /// message too long for a read mailbox of `reply_bytes` becomes a mailbox error. A full queue
    /// drops it.
    pub(super) fn push(
        &mut self,
        ready: u64,
        to: MessageAddress,
        messages: Vec<Vec<u8>>,
        reply_bytes: usize,
    ) {
        let fits = |message: &Vec<u8>| HEADER_BYTES + message.len() <= reply_bytes;
        let answer = if messages.iter().all(fits) {
            Answer { ready, to, messages: messages.into() }
        } else {
            Answer {
                ready,
                to: MessageAddress { protocol: protocol::ERROR, ..to },
                messages: VecDeque::from([MailboxError::InvalidSize.message()]),
            }
        };
        if !self.is_full() && !answer.messages.is_empty() {
            self.answers.push_back(answer);
        }
    }

    pub(super) fn next_ready(&self) -> Option<u64> {
        self.answers.front().map(|answer| answer.ready)
    }

    /// Copies the next message that is ready by `now` into the read mailbox.
    pub(super) fn send(&mut self, now: u64, out: &mut [u8]) -> bool {
        while let Some(answer) = self.answers.front_mut().filter(|answer| answer.ready <= now) {
            let (to, message) = (answer.to, answer.messages.pop_front());
            if answer.messages.is_empty() {
                self.answers.pop_front();
            }
            if message.is_some_and(|message| self.write(to, &message, out)) {
                return true;
            }
        }
        false
    }

    /// Copies a message into the read mailbox; returns `false` if it does not fit.
    pub(super) fn write(&mut self, to: MessageAddress, message: &[u8], out: &mut [u8]) -> bool {
        let Ok(length) = u16::try_from(message.len()) else {
            return false;
        };
        if HEADER_BYTES + message.len() > out.len() {
            return false;
        }
        self.counter = self.counter % 7 + 1;
        let MessageAddress { address, protocol } = to;
        let header = Header { length, address, channel: 0, protocol, counter: self.counter };
        let Some((head, rest)) = out.split_at_mut_checked(HEADER_BYTES) else {
            return false;
        };
        head.copy_from_slice(&header.to_bytes());
        let (body, remaining) = rest.split_at_mut(message.len());
        body.copy_from_slice(message);
        remaining.fill(0);
        true
    }
}

pub(super) mod service {
    pub(in crate::mailbox) const EMERGENCY: u8 = 1;
    pub(in crate::mailbox) const SDO_REQUEST: u8 = 2;
    pub(in crate::mailbox) const SDO_RESPONSE: u8 = 3;
    pub(in crate::mailbox) const TX_PDO: u8 = 4;
    pub(in crate::mailbox) const RX_PDO_REMOTE_REQUEST: u8 = 7;
    pub(in crate::mailbox) const SDO_INFORMATION: u8 = 8;
}

pub(super) const COE_HEADER_BYTES: usize = 2;

/// A message with the CoE header number 0.
pub(super) fn coe_message(service: u8, parts: &[&[u8]]) -> Vec<u8> {
    let header = (u16::from(service) << 12).to_le_bytes();
    [&header[..], &parts.concat()].concat()
}

/// Gateway, time and reply size with which a request is processed.
pub(super) struct Context<'a> {
    pub(super) now: u64,
    /// Bytes of the read mailbox after its header.
    pub(super) room: usize,
    pub(super) gateway: &'a mut Gateway,
}

impl Context<'_> {
    pub(super) fn objects(&mut self) -> ObjectAccess<'_> {
        self.gateway.objects(self.now)
    }

    pub(super) fn variant(&self) -> &GatewayVariant {
        &self.gateway.config().variant
    }

    pub(super) fn sdo_upload(&mut self, index: u16, subindex: u8) -> Result<Vec<u8>, AbortCode> {
        let mut data = Vec::new();
        self.gateway.sdo_upload(self.now, index, subindex, &mut data).map(|()| data)
    }

    pub(super) fn sdo_download(
        &mut self,
        index: u16,
        subindex: u8,
        data: &[u8],
    ) -> Result<(), AbortCode> {
        self.gateway.sdo_download(self.now, index, subindex, data)
    }
}
