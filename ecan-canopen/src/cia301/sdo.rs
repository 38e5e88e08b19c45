//! Common parts of the SDO frames of both directions (CiA 301, 7.2.4.3).

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
