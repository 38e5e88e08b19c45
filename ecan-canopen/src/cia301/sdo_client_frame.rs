//! Frames of the SDO client, to the node (CiA 301, 7.2.4.3).

use ecan_protocol::object::AbortCode;

use super::sdo::{ABORT, Initiate, SdoDecodeError, Segment, object_frame, object_parts, whole};

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
