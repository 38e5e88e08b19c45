//! Number of bits of a frame on the wire, and its duration.

use ecan_protocol::can::{CanFrame, FrameKind};

use super::crc::CRC15;
use super::header_bits::HeaderBits;
use super::stuffing::StuffCounter;

/// Bits between the end of a frame and the earliest next SOF.
pub const INTERMISSION_BITS: u32 = 3;
/// ACK slot, ACK delimiter and EOF.
const TRAILER_BITS: u32 = 9;

/// Exact length of one frame on the wire, from SOF to the end of EOF, including stuff bits.
///
/// With bit rate switching the bus changes to the data bit rate at the sample point of the BRS bit
/// and back at the sample point of the CRC delimiter. The two bits together last one nominal and
/// one data bit for any sample point, if it is equal in both; BRS is counted as the nominal one and
/// the CRC delimiter as the data one.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FrameTiming {
    /// Bits sent at the nominal bit rate.
    pub nominal_bits: u16,
    /// Bits sent at the data bit rate; 0 without bit rate switching.
    pub data_bits: u16,
    /// Number of dynamic stuff bits; without the fixed ones of FD frames.
    pub stuff_bits: u16,
    /// Bits from SOF to BRS in an FD frame, or to the last DLC bit of a classic one, inclusive.
    pub header_bits: u16,
}

impl FrameTiming {
    /// Measures a frame. Real-time safe.
    #[must_use]
    pub fn of(frame: &CanFrame) -> Self {
        match frame.kind() {
            FrameKind::Fd { brs, .. } => Self::fd(frame, brs),
            FrameKind::Data | FrameKind::Remote => Self::classic(frame),
        }
    }

    fn classic(frame: &CanFrame) -> Self {
        let header = HeaderBits::of(frame);
        let mut counter = StuffCounter::new();
        counter.bits(header.bits, header.length);
        let header_bits = header.length + counter.count();

        // The CRC starts with 0, so zeros before SOF change nothing and the header can be processed
        // in bytes.
        let mut crc = CRC15.start();
        let skipped = 8 - header.length.div_ceil(8) as usize;
        for &byte in header.bits.to_be_bytes().iter().skip(skipped) {
            crc = CRC15.byte(crc, byte);
        }
        for &byte in frame.data() {
            counter.byte(byte);
            crc = CRC15.byte(crc, byte);
        }
        counter.bits(u64::from(crc), 15);
        let stuff = counter.count() + u32::from(counter.is_due());
        let unstuffed = header.length + 8 * frame.data().len() as u32 + 15 + 1 + TRAILER_BITS;
        Self {
            nominal_bits: (unstuffed + stuff) as u16,
            data_bits: 0,
            stuff_bits: stuff as u16,
            header_bits: header_bits as u16,
        }
    }

    fn fd(frame: &CanFrame, brs: bool) -> Self {
        let header = HeaderBits::of(frame);
        let rest = header.length - header.before_switch;
        let mut counter = StuffCounter::new();
        counter.bits(header.bits >> rest, header.before_switch);
        let before = header.before_switch + counter.count();
        counter.bits(header.bits, rest);
        for &byte in frame.data() {
            counter.byte(byte);
        }
        let stuff = counter.count();
        let data = frame.data().len();
        let after_switch = rest + 8 * data as u32 + stuff + header.before_switch - before
            + fd_crc_field_bits(data)
            + 1;
        let (nominal_bits, data_bits) = if brs {
            (before + TRAILER_BITS, after_switch)
        } else {
            (before + after_switch + TRAILER_BITS, 0)
        };
        Self {
            nominal_bits: nominal_bits as u16,
            data_bits: data_bits as u16,
            stuff_bits: stuff as u16,
            header_bits: before as u16,
        }
    }

    /// Total number of bits from SOF to the end of EOF.
    #[must_use]
    pub const fn total_bits(&self) -> u32 {
        self.nominal_bits as u32 + self.data_bits as u32
    }

    /// Time from SOF to the end of EOF in nanoseconds, each phase rounded to the nearest.
    ///
    /// Bit rates in bit/s; a rate of 0 counts as 1.
    #[must_use]
    pub fn duration_ns(&self, nominal_bitrate: u32, data_bitrate: u32) -> u64 {
        let nominal = bits_ns(u32::from(self.nominal_bits), nominal_bitrate);
        if self.data_bits == 0 {
            nominal
        } else {
            nominal + bits_ns(u32::from(self.data_bits), data_bitrate)
        }
    }
}

/// Time of `bits` bits at `bitrate` bit/s, in nanoseconds, rounded to the nearest.
#[must_use]
pub fn bits_ns(bits: u32, bitrate: u32) -> u64 {
    let rate = u64::from(bitrate.max(1));
    (u64::from(bits) * 1_000_000_000 + rate / 2) / rate
}

/// Stuff count, CRC and the fixed stuff bits: one before, and one after every four bits.
pub(super) const fn fd_crc_field_bits(data_bytes: usize) -> u32 {
    let bits = if data_bytes <= 16 { 4 + 17 } else { 4 + 21 };
    bits + 1 + bits / 4
}
