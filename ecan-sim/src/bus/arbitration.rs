//! Arbitration between stations that start at the same time.

use ecan_protocol::can::CanFrame;

/// The arbitration field as 32 bits in the order of transmission; the lower value wins.
///
/// Eleven identifier bits, RTR or SRR, IDE, then the eighteen bits and RTR of an extended frame. So
/// a data frame wins over the remote frame of its identifier, and a standard frame over every
/// extended one that begins with the same eleven bits. An FD frame has a dominant RRS bit instead
/// of the RTR bit of a classic data frame: in arbitration the two are equal.
#[must_use]
pub fn arbitration_key(frame: &CanFrame) -> u32 {
    let id = frame.id().raw();
    let remote = u32::from(frame.is_remote());
    if frame.id().is_extended() {
        (id >> 18) << 21 | 0b11 << 19 | (id & 0x3_FFFF) << 1 | remote
    } else {
        id << 21 | remote << 20
    }
}
