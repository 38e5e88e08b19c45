//! Mailbox header (ETG.1000.4): six bytes before every message.

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
