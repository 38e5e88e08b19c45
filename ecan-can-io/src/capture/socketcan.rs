//! Packets of `LINKTYPE_CAN_SOCKETCAN`.

use ecan_protocol::can::{CanFrame, FrameKind};

use crate::capture::error_frame::ErrorFrame;

/// Link type of CAN frames.
pub const LINK_TYPE: u16 = 227;
/// Size of the header before the data, in bytes.
const HEADER_BYTES: usize = 8;

const EXTENDED: u32 = 1 << 31;
const REMOTE: u32 = 1 << 30;
const ERROR: u32 = 1 << 29;
const BIT_RATE_SWITCH: u8 = 1;
const ERROR_STATE: u8 = 2;
const FD: u8 = 4;
/// Maximum length of a classic frame in bytes.
const CLASSIC_BYTES: u8 = 8;

/// Header of a data, remote or FD frame, without its data.
pub fn frame_header(frame: &CanFrame) -> [u8; HEADER_BYTES] {
    let id = frame.id().raw() | if frame.id().is_extended() { EXTENDED } else { 0 };
    let dlc = frame.dlc().value();
    // A classic frame with a DLC above 8 has 8 bytes; its DLC has a field of its own.
    let raw_dlc = if dlc > CLASSIC_BYTES { dlc } else { 0 };
    let length = frame.data().len() as u8;
    match frame.kind() {
        FrameKind::Data => header(id, length, 0, raw_dlc),
        FrameKind::Remote => header(id | REMOTE, dlc.min(CLASSIC_BYTES), 0, raw_dlc),
        FrameKind::Fd { brs, esi } => {
            let switch = if brs { BIT_RATE_SWITCH } else { 0 };
            let state = if esi { ERROR_STATE } else { 0 };
            header(id, length, FD | switch | state, 0)
        }
    }
}

/// Header of an error frame, without its 8 data bytes.
pub fn error_header(error: &ErrorFrame) -> [u8; HEADER_BYTES] {
    header(error.classes() | ERROR, CLASSIC_BYTES, 0, 0)
}

/// The CAN ID is big-endian in this link type.
fn header(id: u32, length: u8, flags: u8, raw_dlc: u8) -> [u8; HEADER_BYTES] {
    let [a, b, c, d] = id.to_be_bytes();
    [a, b, c, d, length, flags, 0, raw_dlc]
}
