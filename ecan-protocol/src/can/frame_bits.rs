//! Length of a frame on the bus by its format: without stuff bits, and with the largest possible number
//! (ISO 11898-1).

use super::frame::{FrameKind, FrameRef};

const CRC15_BITS: u32 = 15;
const CRC_DELIMITER_BITS: u32 = 1;
/// Acknowledge slot and delimiter, end of frame, intermission.
const TRAILER_BITS: u32 = 2 + 7 + 3;
/// ESI and DLC, which an FD frame sends after the bit rate switch.
const FD_CONTROL_BITS: u32 = 1 + 4;

/// Bits of one frame on the bus, from SOF to the end of the intermission.
///
/// With bit rate switching the CRC delimiter counts as the last bit of the data phase, and BRS as
/// the last one before it: exact if both phases have the same sample point.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FrameBits {
    /// Bits at the nominal bit rate.
    pub nominal: u32,
    /// Bits at the data bit rate; 0 without bit rate switching.
    pub data: u32,
}

impl FrameBits {
    /// Returns the bits of the frame with only the fixed stuff bits of CAN FD. Only the sizes of CAN ID
    /// and data count. Real-time safe.
    pub fn least(frame: FrameRef<'_>) -> Self {
        let data_bits = 8 * frame.data().len() as u32;
        match frame.kind() {
            FrameKind::Data | FrameKind::Remote => Self {
                nominal: classic_stuffed(frame) + CRC_DELIMITER_BITS + TRAILER_BITS,
                data: 0,
            },
            FrameKind::Fd { brs, .. } => {
                let head = fd_head(frame) + TRAILER_BITS;
                let body = FD_CONTROL_BITS + data_bits + crc_field(frame) + CRC_DELIMITER_BITS;
                Self::in_phases(head, body, brs)
            }
        }
    }

    /// Returns the bits of the frame with the largest number of stuff bits for its sizes: one after the
    /// first five bits, then one after every four. Real-time safe.
    pub fn most(frame: FrameRef<'_>) -> Self {
        let least = Self::least(frame);
        match frame.kind() {
            FrameKind::Data | FrameKind::Remote => {
                Self { nominal: least.nominal + (classic_stuffed(frame) - 1) / 4, data: 0 }
            }
            FrameKind::Fd { brs, .. } => {
                // A stuff bit belongs to the phase of the next bit, and five equal bits at the end
                // of the data field get none: the CRC field begins with a fixed one.
                let before = (fd_head(frame) - 2) / 4;
                let after = 1 + (FD_CONTROL_BITS + 8 * frame.data().len() as u32 - 1) / 4;
                let stuff = Self::in_phases(before, after, brs);
                Self { nominal: least.nominal + stuff.nominal, data: least.data + stuff.data }
            }
        }
    }

    const fn in_phases(head: u32, body: u32, brs: bool) -> Self {
        if brs {
            Self { nominal: head, data: body }
        } else {
            Self { nominal: head + body, data: 0 }
        }
    }

    /// Bits of both phases.
    pub const fn total(self) -> u32 {
        self.nominal + self.data
    }

    /// Time on the bus in seconds, at bit rates in bit/s; a rate of 0 counts as 1.
    pub fn seconds(self, nominal_bitrate: u32, data_bitrate: u32) -> f64 {
        f64::from(self.nominal) / f64::from(nominal_bitrate.max(1))
            + f64::from(self.data) / f64::from(data_bitrate.max(1))
    }
}

/// Bits of a classic frame that are stuffed: SOF to the end of the CRC sequence.
fn classic_stuffed(frame: FrameRef<'_>) -> u32 {
    // SOF; CAN ID with RTR, and SRR where extended; IDE; reserved bits; DLC.
    let header = if frame.id().is_extended() { 1 + 31 + 1 + 2 + 4 } else { 1 + 12 + 1 + 1 + 4 };
    header + 8 * frame.data().len() as u32 + CRC15_BITS
}

/// Bits of an FD frame from SOF to BRS.
fn fd_head(frame: FrameRef<'_>) -> u32 {
    // SOF; CAN ID with RRS, and SRR where extended; IDE; FDF, res, BRS.
    if frame.id().is_extended() { 1 + 31 + 1 + 3 } else { 1 + 12 + 1 + 3 }
}

/// Stuff count, CRC and their fixed stuff bits: one before them, one after every four bits.
fn crc_field(frame: FrameRef<'_>) -> u32 {
    let bits = if frame.data().len() > 16 { 4 + 21 } else { 4 + 17 };
    bits + 1 + bits / 4
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::can::{CanFrame, CanId, Dlc};

    fn standard() -> CanId {
        CanId::standard(0).unwrap()
    }

    fn extended() -> CanId {
        CanId::extended(0).unwrap()
    }

    fn totals(frame: CanFrame) -> (u32, u32) {
        let frame = frame.as_ref();
        (FrameBits::least(frame).total(), FrameBits::most(frame).total())
    }

    /// 1 + 11 + 1 + 1 + 1 + 4 + 15 + 1 + 2 + 7 + 3 = 47 and 8 a byte; 34 of them and the data are
    /// stuffed: 33/4 = 8, 97/4 = 24. Extended there are 20 more: (118 - 1)/4 = 29.
    #[test]
    fn classic_frame_bits_match_the_literature() {
        let frame = |id, length| CanFrame::classic(id, &[0; 8][..length]).unwrap();
        assert_eq!(totals(frame(standard(), 0)), (47, 55));
        assert_eq!(totals(frame(standard(), 6)), (95, 115));
        assert_eq!(totals(frame(standard(), 8)), (111, 135));
        assert_eq!(totals(frame(extended(), 0)), (67, 80));
        assert_eq!(totals(frame(extended(), 8)), (131, 160));
        let remote = CanFrame::remote(standard(), Dlc::new(8).unwrap()).unwrap();
        assert_eq!(totals(remote), (47, 55));
    }

    /// Standard, 64 bytes: 17 up to BRS and 12 after the CRC delimiter; 5 + 512 + 32 + 1 between.
    /// Stuff bits: after bit 5, 9, 13 before the switch; after bit 17, 21, .. of the 517.
    #[test]
    fn fd_frame_bits_are_counted_by_phase() {
        let frame = CanFrame::fd(standard(), &[0; 64], true, false).unwrap();
        assert_eq!(FrameBits::least(frame.as_ref()), FrameBits { nominal: 29, data: 550 });
        assert_eq!(
            FrameBits::most(frame.as_ref()),
            FrameBits { nominal: 29 + 3, data: 550 + 1 + 129 }
        );
        let steady = CanFrame::fd(standard(), &[0; 64], false, false).unwrap();
        assert_eq!(FrameBits::most(steady.as_ref()), FrameBits { nominal: 712, data: 0 });
        // 4 + 17 + 6 bits of CRC field up to 16 bytes.
        let short = CanFrame::fd(extended(), &[0; 16], true, false).unwrap();
        assert_eq!(
            FrameBits::least(short.as_ref()),
            FrameBits { nominal: 36 + 12, data: 5 + 128 + 27 + 1 }
        );
    }

    #[test]
    fn time_adds_both_phases() {
        let bits = FrameBits { nominal: 500, data: 5_000 };
        assert!((bits.seconds(500_000, 5_000_000) - 0.002).abs() < 1e-12);
        assert!(bits.seconds(0, 0).is_finite());
    }
}
