//! Encoder of socketcand frames.

use std::io::Write as _;

use ecan_protocol::can::{CanFrame, FrameKind};

/// Class of an error frame "transmission timed out" (`linux/can/error.h`).
const TX_TIMEOUT: u32 = 0x001;

/// Appends one error frame for each accepted frame that was not sent, with its time in seconds.
pub(crate) fn encode_losses(count: u64, time_ns: u64, text: &mut Vec<u8>) {
    let (seconds, micros) = parts(time_ns);
    for _ in 0..count {
        // infallible: writing to a vector
        let _ = write!(text, "< error {TX_TIMEOUT:03X} {seconds}.{micros:06} >");
    }
}

/// Seconds, and the microseconds after them.
fn parts(time_ns: u64) -> (u64, u64) {
    (time_ns / 1_000_000_000, time_ns / 1_000 % 1_000_000)
}

/// Appends a received classic frame with its time in seconds. Raw mode has no format for CAN FD.
pub(crate) fn encode(frame: &CanFrame, time_ns: u64, text: &mut Vec<u8>) {
    let word = match frame.kind() {
        FrameKind::Data => "frame",
        FrameKind::Remote => "rtr",
        FrameKind::Fd { .. } => return,
    };
    let digits = if frame.id().is_extended() { 8 } else { 3 };
    let (seconds, micros) = parts(time_ns);
    let id = frame.id().raw();
    // infallible: writing to a vector
    let _ = write!(text, "< {word} {id:0digits$X} {seconds}.{micros:06} ");
    if frame.is_remote() {
        let _ = write!(text, "{}", frame.dlc().value());
    }
    for byte in frame.data() {
        let _ = write!(text, "{byte:02X}");
    }
    text.extend(b" >");
}
