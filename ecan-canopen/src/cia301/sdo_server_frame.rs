//! Frames of the SDO server, from the node (CiA 301, 7.2.4.3).

use ecan_protocol::object::AbortCode;

use super::sdo::{ABORT, Initiate, SdoDecodeError, Segment, object_frame, object_parts, whole};

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
