//! SDO frames of client and server, block transfer included (CiA 301, 7.2.4.3).

use ecan_protocol::object::AbortCode;
use thiserror::Error;

/// Error: data that is not an SDO frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum SdoDecodeError {
    /// SDO frames have 8 data bytes.
    #[error("an SDO frame has 8 data bytes, not {length}")]
    Length {
        /// Bytes that came.
        length: usize,
    },
    /// No such command.
    #[error("0x{command:02X} is no SDO command")]
    Command {
        /// First byte of the frame.
        command: u8,
    },
}

/// Begin of a transfer: all of a short value, or the size of a long one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Initiate {
    /// The value itself, up to 4 bytes.
    Expedited {
        /// The value; bytes after its length are 0 or without meaning.
        data: [u8; 4],
        /// Its length, 1 to 4; `None` if not given.
        length: Option<u8>,
    },
    /// Segments follow.
    Segmented {
        /// Bytes in all; `None` if not given.
        size: Option<u32>,
    },
}

impl Initiate {
    /// An expedited value of up to 4 bytes; `None` for an empty or a longer one.
    pub fn expedited(value: &[u8]) -> Option<Self> {
        let length = u8::try_from(value.len()).ok().filter(|length| (1..=4).contains(length))?;
        let mut data = [0; 4];
        for (to, from) in data.iter_mut().zip(value) {
            *to = *from;
        }
        Some(Self::Expedited { data, length: Some(length) })
    }

    pub(crate) const fn encode(self) -> (u8, [u8; 4]) {
        match self {
            Self::Expedited { data, length: Some(length) } => {
                let unused = 4 - if length > 4 { 4 } else { length };
                (unused << 2 | 0b11, data)
            }
            Self::Expedited { data, length: None } => (0b10, data),
            Self::Segmented { size: Some(size) } => (0b01, size.to_le_bytes()),
            Self::Segmented { size: None } => (0b00, [0; 4]),
        }
    }

    pub(crate) const fn decode(command: u8, tail: [u8; 4]) -> Self {
        match command & 0b11 {
            0b11 => Self::Expedited { data: tail, length: Some(4 - (command >> 2 & 0b11)) },
            0b10 => Self::Expedited { data: tail, length: None },
            0b01 => Self::Segmented { size: Some(u32::from_le_bytes(tail)) },
            _ => Self::Segmented { size: None },
        }
    }
}

/// A segment of a long value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Segment {
    /// Alternates, beginning with false.
    pub toggle: bool,
    /// True if it is the last.
    pub last: bool,
    /// Its bytes.
    pub data: [u8; 7],
    /// Number of valid bytes, 0 to 7.
    pub length: u8,
}

impl Segment {
    /// A segment of up to 7 bytes; what is longer is cut.
    pub fn new(toggle: bool, value: &[u8], last: bool) -> Self {
        let mut data = [0; 7];
        for (to, from) in data.iter_mut().zip(value) {
            *to = *from;
        }
        Self { toggle, last, data, length: value.len().min(7) as u8 }
    }

    /// The bytes that count.
    pub fn bytes(&self) -> &[u8] {
        self.data.get(..usize::from(self.length)).unwrap_or(&self.data)
    }

    pub(crate) fn encode(self, command: u8) -> [u8; 8] {
        let unused = 7 - self.length.min(7);
        let head = command | u8::from(self.toggle) << 4 | unused << 1 | u8::from(self.last);
        let mut frame = [0; 8];
        frame[0] = head;
        frame[1..].copy_from_slice(&self.data);
        frame
    }

    pub(crate) fn decode(frame: &[u8; 8]) -> Self {
        let [head, data @ ..] = *frame;
        Self {
            toggle: head & 0x10 != 0,
            last: head & 1 != 0,
            data,
            length: 7 - (head >> 1 & 0b111),
        }
    }
}

/// A frame about an object: command, index, subindex, four more bytes.
pub(crate) const fn object_frame(command: u8, index: u16, subindex: u8, tail: [u8; 4]) -> [u8; 8] {
    let [low, high] = index.to_le_bytes();
    let [a, b, c, d] = tail;
    [command, low, high, subindex, a, b, c, d]
}

pub(crate) const fn object_parts(frame: &[u8; 8]) -> (u8, u16, u8, [u8; 4]) {
    let [command, low, high, subindex, a, b, c, d] = *frame;
    (command, u16::from_le_bytes([low, high]), subindex, [a, b, c, d])
}

/// The eight bytes of a frame.
pub(crate) fn whole(data: &[u8]) -> Result<&[u8; 8], SdoDecodeError> {
    data.try_into().map_err(|_| SdoDecodeError::Length { length: data.len() })
}

pub(crate) const ABORT: u8 = 0x80;

/// Most segments of a block.
pub const MAX_BLOCK_SIZE: u8 = 127;

const END: u8 = 0x80;

/// A segment of a block: it has no command, only its number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BlockSegment {
    /// Number in the block, 1 to 127.
    pub sequence: u8,
    /// True if it is the last of the value.
    pub last: bool,
    /// Its bytes; in the last segment some may not count.
    pub data: [u8; 7],
}

impl BlockSegment {
    /// A segment of up to 7 bytes, filled up with zeros.
    pub fn new(sequence: u8, value: &[u8], last: bool) -> Self {
        let mut data = [0; 7];
        for (to, from) in data.iter_mut().zip(value) {
            *to = *from;
        }
        Self { sequence: sequence & !END, last, data }
    }

    /// The frame.
    pub fn to_bytes(self) -> [u8; 8] {
        let mut frame = [0; 8];
        frame[0] = self.sequence & !END | if self.last { END } else { 0 };
        frame[1..].copy_from_slice(&self.data);
        frame
    }

    /// Reads a frame that comes while a block is under way; `None` without a number from 1 to
    /// 127 or without 8 bytes. An abort (0x80) has the number 0.
    pub fn parse(data: &[u8]) -> Option<Self> {
        let &[head, a, b, c, d, e, f, g] = data else { return None };
        let sequence = head & !END;
        (sequence > 0).then_some(Self {
            sequence,
            last: head & END != 0,
            data: [a, b, c, d, e, f, g],
        })
    }
}

/// CRC of a value that block transfer carries: CRC-16 with polynomial 0x1021 and start value 0
/// (XMODEM). `crc` is that of what came before, 0 at first.
pub fn block_crc(crc: u16, value: &[u8]) -> u16 {
    value.iter().fold(crc, |crc, byte| {
        let nth = usize::from((crc >> 8) as u8 ^ byte);
        // infallible: a byte indexes a table of 256
        crc << 8 ^ TABLE[nth]
    })
}

static TABLE: [u16; 256] = table();

const fn table() -> [u16; 256] {
    let mut table = [0; 256];
    let mut byte = 0;
    while byte < 256 {
        let mut crc = (byte as u16) << 8;
        let mut bit = 0;
        while bit < 8 {
            crc = if crc & 0x8000 == 0 { crc << 1 } else { crc << 1 ^ 0x1021 };
            bit += 1;
        }
        table[byte] = crc;
        byte += 1;
    }
    table
}

/// A frame of the SDO client. Segments of a block download are
/// [`BlockSegment`](crate::BlockSegment)s instead.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ClientFrame {
    /// Asks for an object.
    Upload {
        /// Index.
        index: u16,
        /// Subindex.
        subindex: u8,
    },
    /// Asks for the next segment.
    UploadSegment {
        /// Alternates, beginning with false.
        toggle: bool,
    },
    /// Begins to write an object.
    Download {
        /// Index.
        index: u16,
        /// Subindex.
        subindex: u8,
        /// The value or its size.
        initiate: Initiate,
    },
    /// The next segment.
    DownloadSegment(Segment),
    /// Asks for an object by block transfer.
    BlockUpload {
        /// Index.
        index: u16,
        /// Subindex.
        subindex: u8,
        /// Segments per block that the client takes, 1 to 127.
        block_size: u8,
        /// Below this number of bytes the server may change to a segmented transfer; 0 forbids it.
        switch_threshold: u8,
        /// The client checks the CRC.
        crc: bool,
    },
    /// Lets the server send the first block.
    BlockUploadStart,
    /// Acknowledges a block.
    BlockUploadAck {
        /// Last segment that came in order, 0 for none.
        received: u8,
        /// Segments of the next block.
        block_size: u8,
    },
    /// Acknowledges the end of a block upload.
    BlockUploadEnd,
    /// Begins to write an object by block transfer.
    BlockDownload {
        /// Index.
        index: u16,
        /// Subindex.
        subindex: u8,
        /// Bytes in all, if given.
        size: Option<u32>,
        /// The client computes the CRC.
        crc: bool,
    },
    /// Ends a block download.
    BlockDownloadEnd {
        /// Bytes of the last segment that do not count, 0 to 7.
        unused: u8,
        /// CRC of the value; 0 without.
        crc: u16,
    },
    /// Aborts a transfer.
    Abort {
        /// Index.
        index: u16,
        /// Subindex.
        subindex: u8,
        /// Reason.
        code: AbortCode,
    },
}

impl ClientFrame {
    /// The data of the CAN frame.
    pub fn to_bytes(self) -> [u8; 8] {
        match self {
            Self::Upload { index, subindex } => object_frame(0x40, index, subindex, [0; 4]),
            Self::UploadSegment { toggle } => [0x60 | u8::from(toggle) << 4, 0, 0, 0, 0, 0, 0, 0],
            Self::Download { index, subindex, initiate } => {
                let (bits, tail) = initiate.encode();
                object_frame(0x20 | bits, index, subindex, tail)
            }
            Self::DownloadSegment(segment) => segment.encode(0x00),
            Self::BlockUpload { index, subindex, block_size, switch_threshold, crc } => {
                let tail = [block_size, switch_threshold, 0, 0];
                object_frame(0xA0 | u8::from(crc) << 2, index, subindex, tail)
            }
            Self::BlockUploadStart => [0xA3, 0, 0, 0, 0, 0, 0, 0],
            Self::BlockUploadAck { received, block_size } => {
                [0xA2, received, block_size, 0, 0, 0, 0, 0]
            }
            Self::BlockUploadEnd => [0xA1, 0, 0, 0, 0, 0, 0, 0],
            Self::BlockDownload { index, subindex, size, crc } => {
                let command = 0xC0 | u8::from(crc) << 2 | u8::from(size.is_some()) << 1;
                object_frame(command, index, subindex, size.unwrap_or(0).to_le_bytes())
            }
            Self::BlockDownloadEnd { unused, crc } => {
                let [low, high] = crc.to_le_bytes();
                [0xC1 | (unused & 0b111) << 2, low, high, 0, 0, 0, 0, 0]
            }
            Self::Abort { index, subindex, code } => {
                object_frame(ABORT, index, subindex, code.0.to_le_bytes())
            }
        }
    }

    /// Reads the data of a CAN frame.
    ///
    /// # Errors
    /// [`SdoDecodeError`].
    pub fn parse(data: &[u8]) -> Result<Self, SdoDecodeError> {
        let frame = whole(data)?;
        let (command, index, subindex, tail) = object_parts(frame);
        Ok(match command >> 5 {
            0 => Self::DownloadSegment(Segment::decode(frame)),
            1 => Self::Download { index, subindex, initiate: Initiate::decode(command, tail) },
            2 => Self::Upload { index, subindex },
            3 => Self::UploadSegment { toggle: command & 0x10 != 0 },
            4 => Self::Abort { index, subindex, code: AbortCode(u32::from_le_bytes(tail)) },
            5 => match command & 0b11 {
                0 => Self::BlockUpload {
                    index,
                    subindex,
                    block_size: tail[0],
                    switch_threshold: tail[1],
                    crc: command & 0b100 != 0,
                },
                1 => Self::BlockUploadEnd,
                2 => Self::BlockUploadAck { received: frame[1], block_size: frame[2] },
                _ => Self::BlockUploadStart,
            },
            6 if command & 1 == 0 => Self::BlockDownload {
                index,
                subindex,
                size: (command & 0b10 != 0).then_some(u32::from_le_bytes(tail)),
                crc: command & 0b100 != 0,
            },
            6 => Self::BlockDownloadEnd {
                unused: command >> 2 & 0b111,
                crc: u16::from_le_bytes([frame[1], frame[2]]),
            },
            _ => return Err(SdoDecodeError::Command { command }),
        })
    }
}

/// A frame of the SDO server. Segments of a block upload are
/// [`BlockSegment`](crate::BlockSegment)s instead.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ServerFrame {
    /// Answers an upload with the value or its size.
    Upload {
        /// Index.
        index: u16,
        /// Subindex.
        subindex: u8,
        /// The value or its size.
        initiate: Initiate,
    },
    /// The next segment.
    UploadSegment(Segment),
    /// Accepts a download.
    Download {
        /// Index.
        index: u16,
        /// Subindex.
        subindex: u8,
    },
    /// Accepts a segment.
    DownloadSegment {
        /// That of the segment.
        toggle: bool,
    },
    /// Accepts a block upload.
    BlockUpload {
        /// Index.
        index: u16,
        /// Subindex.
        subindex: u8,
        /// Bytes in all, if given.
        size: Option<u32>,
        /// The server computes the CRC.
        crc: bool,
    },
    /// Ends a block upload.
    BlockUploadEnd {
        /// Bytes of the last segment that do not count, 0 to 7.
        unused: u8,
        /// CRC of the value; 0 without.
        crc: u16,
    },
    /// Accepts a block download.
    BlockDownload {
        /// Index.
        index: u16,
        /// Subindex.
        subindex: u8,
        /// Segments per block that the server takes, 1 to 127.
        block_size: u8,
        /// The server checks the CRC.
        crc: bool,
    },
    /// Acknowledges a block.
    BlockDownloadAck {
        /// Last segment that came in order, 0 for none.
        received: u8,
        /// Segments of the next block.
        block_size: u8,
    },
    /// Acknowledges the end of a block download.
    BlockDownloadEnd,
    /// Rejects, or gives a transfer up.
    Abort {
        /// Index.
        index: u16,
        /// Subindex.
        subindex: u8,
        /// Reason.
        code: AbortCode,
    },
}

impl ServerFrame {
    /// The data of the CAN frame.
    pub fn to_bytes(self) -> [u8; 8] {
        match self {
            Self::Upload { index, subindex, initiate } => {
                let (bits, tail) = initiate.encode();
                object_frame(0x40 | bits, index, subindex, tail)
            }
            Self::UploadSegment(segment) => segment.encode(0x00),
            Self::Download { index, subindex } => object_frame(0x60, index, subindex, [0; 4]),
            Self::DownloadSegment { toggle } => [0x20 | u8::from(toggle) << 4, 0, 0, 0, 0, 0, 0, 0],
            Self::BlockUpload { index, subindex, size, crc } => {
                let command = 0xC0 | u8::from(crc) << 2 | u8::from(size.is_some()) << 1;
                object_frame(command, index, subindex, size.unwrap_or(0).to_le_bytes())
            }
            Self::BlockUploadEnd { unused, crc } => {
                let [low, high] = crc.to_le_bytes();
                [0xC1 | (unused & 0b111) << 2, low, high, 0, 0, 0, 0, 0]
            }
            Self::BlockDownload { index, subindex, block_size, crc } => {
                object_frame(0xA0 | u8::from(crc) << 2, index, subindex, [block_size, 0, 0, 0])
            }
            Self::BlockDownloadAck { received, block_size } => {
                [0xA2, received, block_size, 0, 0, 0, 0, 0]
            }
            Self::BlockDownloadEnd => [0xA1, 0, 0, 0, 0, 0, 0, 0],
            Self::Abort { index, subindex, code } => {
                object_frame(ABORT, index, subindex, code.0.to_le_bytes())
            }
        }
    }

    /// Reads the data of a CAN frame.
    ///
    /// # Errors
    /// [`SdoDecodeError`].
    pub fn parse(data: &[u8]) -> Result<Self, SdoDecodeError> {
        let frame = whole(data)?;
        let (command, index, subindex, tail) = object_parts(frame);
        Ok(match command >> 5 {
            0 => Self::UploadSegment(Segment::decode(frame)),
            1 => Self::DownloadSegment { toggle: command & 0x10 != 0 },
            2 => Self::Upload { index, subindex, initiate: Initiate::decode(command, tail) },
            3 => Self::Download { index, subindex },
            4 => Self::Abort { index, subindex, code: AbortCode(u32::from_le_bytes(tail)) },
            5 => match command & 0b11 {
                0 => Self::BlockDownload {
                    index,
                    subindex,
                    block_size: tail[0],
                    crc: command & 0b100 != 0,
                },
                1 => Self::BlockDownloadEnd,
                2 => Self::BlockDownloadAck { received: frame[1], block_size: frame[2] },
                _ => return Err(SdoDecodeError::Command { command }),
            },
            6 if command & 1 == 0 => Self::BlockUpload {
                index,
                subindex,
                size: (command & 0b10 != 0).then_some(u32::from_le_bytes(tail)),
                crc: command & 0b100 != 0,
            },
            6 => Self::BlockUploadEnd {
                unused: command >> 2 & 0b111,
                crc: u16::from_le_bytes([frame[1], frame[2]]),
            },
            _ => return Err(SdoDecodeError::Command { command }),
        })
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn crc_check_value() {
        assert_eq!(block_crc(0, b"123456789"), 0x31C3);
    }

    proptest! {
        #[test]
        fn crc_is_xmodem(
            value in proptest::collection::vec(any::<u8>(), 0..200),
            cut in any::<proptest::sample::Index>(),
        ) {
            let oracle = crc::Crc::<u16>::new(&crc::CRC_16_XMODEM).checksum(&value);
            let (front, back) = value.split_at(cut.index(value.len() + 1));
            prop_assert_eq!(block_crc(block_crc(0, front), back), oracle);
        }

        #[test]
        fn segments_come_back(sequence in 1..=127u8, last: bool, data: [u8; 7]) {
            let segment = BlockSegment::new(sequence, &data, last);
            prop_assert_eq!(BlockSegment::parse(&segment.to_bytes()), Some(segment));
        }
    }

    #[test]
    fn abort_is_not_a_segment() {
        assert_eq!(BlockSegment::parse(&[0x80, 0, 0, 0, 0, 0, 0, 0]), None);
        assert_eq!(BlockSegment::parse(&[1; 7]), None);
    }
}
