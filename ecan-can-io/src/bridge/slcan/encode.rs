//! Encoder of slcan frames.

use ecan_protocol::can::{CanFrame, FrameKind};

use super::{BELL, OK};

/// Period of timestamps, ms.
const TIMESTAMP_WRAP: u64 = 60_000;

/// Appends a received frame, with a timestamp in milliseconds if `time_ns` is given. slcan cannot
/// represent the error state indicator of CAN FD.
pub(super) fn encode(frame: &CanFrame, time_ns: Option<u64>, text: &mut Vec<u8>) {
    let is_extended = frame.id().is_extended();
    let letter = match frame.kind() {
        FrameKind::Data => b't',
        FrameKind::Remote => b'r',
        FrameKind::Fd { brs: false, .. } => b'd',
        FrameKind::Fd { brs: true, .. } => b'b',
    };
    text.push(if is_extended { letter.to_ascii_uppercase() } else { letter });
    hex(frame.id().raw(), if is_extended { 8 } else { 3 }, text);
    hex(u32::from(frame.dlc().value()), 1, text);
    for &byte in frame.data() {
        hex(u32::from(byte), 2, text);
    }
    if let Some(time_ns) = time_ns {
        // infallible: less than 60000
        hex((time_ns / 1_000_000 % TIMESTAMP_WRAP) as u32, 4, text);
    }
    text.push(OK);
}

/// Appends one BELL for each frame that was confirmed and then lost, in addition to the answers to
/// commands. slcan has no other message that an adapter sends without a command.
pub(crate) fn encode_losses(count: u64, text: &mut Vec<u8>) {
    text.extend((0..count).map(|_| BELL));
}

/// Appends the lowest hexadecimal digits.
pub(super) fn hex(value: u32, digits: u32, text: &mut Vec<u8>) {
    for place in (0..digits).rev() {
        let digit = (value >> (4 * place) & 0xF) as u8;
        text.push(if digit < 10 { b'0' + digit } else { b'A' + digit - 10 });
    }
}
