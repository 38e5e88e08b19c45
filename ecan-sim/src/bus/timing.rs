//! Times on the bus: duration of a frame; sample points, delays of cables and transceivers, and delay compensation.
//!
//! docs/SIMULATION.md describes the model and its limits. A sample succeeds if it is far enough from both
//! ends of its bit.

use ecan_protocol::can::{CanFrame, FrameKind, SamplePoint};

use super::wire_frame::{CRC15, HeaderBits, StuffCounter};
use crate::random::Random;

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

/// A sample at least so far from the ends of its bit never fails (a guess: jitter and asymmetry of edges).
const SAFE_NS: i64 = 15;
/// Probability of 1.
const CERTAIN: u32 = 1_000_000;

/// Transmitter delay compensation of a station.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct DelayCompensation {
    /// Secondary sample point after the measured delay, in ns; 0 is the data sample point.
    pub offset_ns: u32,
    /// Edges that lead to an earlier secondary sample point are not measured, in ns; active if above the
    /// offset.
    pub filter_ns: u32,
}

/// Sample points and delays of a station.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PhysicalLayer {
    /// Sample point of the arbitration phase.
    pub sample_point: SamplePoint,
    /// Sample point of the data phase.
    pub data_sample_point: SamplePoint,
    /// Delay compensation; `None` is off.
    pub compensation: Option<DelayCompensation>,
    /// Delay of the transceiver from its transmit to its receive pin, in ns.
    pub transceiver_ns: u32,
    /// Position on the cable, as the delay from its first end in ns.
    pub cable_ns: u32,
}

/// Bit rates of a frame in bit/s.
#[derive(Clone, Copy)]
pub(super) struct BitRates {
    pub nominal: u32,
    pub data: u32,
}

/// Effect of a receiver's sampling on a frame with bit rate switch.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum SwitchError {
    /// The receiver samples the BRS bit when the first data bit has begun.
    Late,
    /// The receiver samples the first data bit when the BRS bit has not ended.
    Early,
}

impl PhysicalLayer {
    /// Delay of a usual transceiver in ns (a guess).
    pub const TRANSCEIVER_NS: u32 = 150;

    /// A station with compensation and a usual transceiver, at the first end of the cable.
    #[must_use]
    pub const fn new(sample_point: SamplePoint, data_sample_point: SamplePoint) -> Self {
        Self {
            sample_point,
            data_sample_point,
            compensation: Some(DelayCompensation { offset_ns: 0, filter_ns: 0 }),
            transceiver_ns: Self::TRANSCEIVER_NS,
            cable_ns: 0,
        }
    }

    /// Probability, in millionths, that the station reads back its own data bits wrongly.
    pub(super) fn echo_error(&self, rates: BitRates) -> u32 {
        let (bit, sample) = self.data_phase_ns(rates);
        let delay = i64::from(self.transceiver_ns);
        let Some(DelayCompensation { offset_ns, filter_ns }) = self.compensation else {
            return failure(sample - delay, sample);
        };
        let offset = if offset_ns == 0 { sample } else { i64::from(offset_ns) };
        let filter = i64::from(filter_ns);
        // the filter suppresses the edge that is to be measured
        if filter > offset && filter > delay + offset {
            return CERTAIN;
        }
        failure(offset, sample).max(failure(bit - offset, bit - sample))
    }

    /// Error of a receiver at the bit rate switch, and its probability in millionths.
    ///
    /// The stations switch at their nominal sample points, so the receiver's first samples in the data phase
    /// are off by the difference. Resynchronisation follows with the edge to the first data bit only.
    pub(super) fn switch_error(&self, receiver: &Self, rates: BitRates) -> (SwitchError, u32) {
        let (bit, sample) = self.data_phase_ns(rates);
        let shift = receiver.nominal_ns(rates) - self.nominal_ns(rates);
        if shift > 0 {
            (SwitchError::Late, failure(bit - sample - shift, bit - sample))
        } else {
            (SwitchError::Early, failure(sample + shift, sample))
        }
    }

    /// Probability, in millionths, that the acknowledgement of a receiver comes too late for the sender.
    pub(super) fn late_acknowledge(&self, receiver: &Self, rates: BitRates, switches: bool) -> u32 {
        let sample = self.nominal_ns(rates);
        let cable = i64::from(self.cable_ns.abs_diff(receiver.cable_ns));
        let transceivers = i64::from(self.transceiver_ns) + i64::from(receiver.transceiver_ns);
        // the stations leave the data phase at their data sample points
        let later = if switches {
            let rest = |station: &Self| station.data_phase_ns(rates).1 - station.nominal_ns(rates);
            rest(receiver) - rest(self)
        } else {
            0
        };
        failure(sample - 2 * cable - transceivers - later, sample)
    }

    fn nominal_ns(&self, rates: BitRates) -> i64 {
        part_ns(self.sample_point, rates.nominal)
    }

    /// Duration of a data bit, and its sample point.
    fn data_phase_ns(&self, rates: BitRates) -> (i64, i64) {
        (part_ns(SamplePoint(10_000), rates.data), part_ns(self.data_sample_point, rates.data))
    }
}

fn part_ns(point: SamplePoint, bitrate: u32) -> i64 {
    i64::from(point.0) * 100_000 / i64::from(bitrate.max(1))
}

/// Probability, in millionths, that a sample fails at a distance from an end of its bit: it grows with the
/// square of what is missing to the safe distance. `usual` is the distance that the station has chosen.
fn failure(distance: i64, usual: i64) -> u32 {
    let safe = SAFE_NS.min(usual);
    if distance >= safe {
        return 0;
    }
    if distance <= 0 {
        return CERTAIN;
    }
    let missing = (safe - distance) as u32;
    CERTAIN * (missing * missing) / (safe * safe) as u32
}

/// What a number is drawn for.
#[derive(Clone, Copy)]
pub(super) enum Sample {
    Echo = 1,
    Switch = 2,
    Acknowledge = 3,
}

/// Random numbers of one transmission: equal for equal questions.
#[derive(Clone, Copy, Debug)]
pub(super) struct Draw(pub(super) u64);

impl Draw {
    /// True with a probability in millionths, for one station.
    pub(super) fn hits(self, probability: u32, station: usize, sample: Sample) -> bool {
        match probability {
            0 => false,
            CERTAIN => true,
            _ => {
                let seed = self.0 ^ (station as u64) << 48 ^ (sample as u64) << 40;
                Random::new(seed).below(u64::from(CERTAIN)) < u64::from(probability)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn failure_grows_inside_the_last_15_ns() {
        let of = |distance| failure(distance, 100);
        assert_eq!([15, 14, 5, 1, 0, -1].map(of), [0, 4_444, 444_444, 871_111, CERTAIN, CERTAIN]);
        assert_eq!(failure(10, 10), 0, "a sample at its own distance");
        assert_eq!(failure(5, 10), 250_000);
    }

    #[test]
    fn draws_follow_their_probability() {
        let hits = (0..10_000).filter(|n| Draw(*n).hits(100_000, 1, Sample::Switch)).count();
        assert!((800..1200).contains(&hits), "{hits}");
    }
}
