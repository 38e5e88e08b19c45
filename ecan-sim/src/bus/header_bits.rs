//! The unstuffed bits before the data field.

use ecan_protocol::can::{CanFrame, FrameKind};

/// SOF, arbitration and control field of a frame, unstuffed; the first bit on the wire is the most
/// significant of `length` bits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct HeaderBits {
    pub bits: u64,
    pub length: u32,
    /// Bits up to BRS in an FD frame, inclusive; the whole header in a classic one.
    pub before_switch: u32,
}

impl HeaderBits {
    pub(super) fn of(frame: &CanFrame) -> Self {
        let id = u64::from(frame.id().raw());
        let dlc = u64::from(frame.dlc().value());
        let mut header = Self {
            bits: 0,
            length: 1, // SOF is dominant
            before_switch: 0,
        };
        let remote = u64::from(frame.is_remote());
        if frame.id().is_extended() {
            header.push(id >> 18, 11);
            header.push(0b11, 2); // SRR, IDE
            header.push(id & 0x3_FFFF, 18);
            header.push(remote, 1); // RTR, or RRS of an FD frame, always dominant
        } else {
            header.push(id, 11);
            header.push(remote, 1);
            header.push(0, 1); // IDE
        }
        match frame.kind() {
            FrameKind::Fd { brs, esi } => {
                header.push(0b10, 2); // FDF, res
                header.push(u64::from(brs), 1);
                header.before_switch = header.length;
                header.push(u64::from(esi), 1);
                header.push(dlc, 4);
            }
            FrameKind::Data | FrameKind::Remote => {
                // FDF, followed by r0 in extended format.
                header.push(0, if frame.id().is_extended() { 2 } else { 1 });
                header.push(dlc, 4);
                header.before_switch = header.length;
            }
        }
        header
    }

    fn push(&mut self, value: u64, count: u32) {
        self.bits = self.bits << count | value;
        self.length += count;
    }
}
