//! The bit sequence of a frame, as a logic analyser shows it.

use core::ops::Range;

use ecan_protocol::can::{CanFrame, FrameKind};

use super::crc::{BitCrc, CRC15, CRC17, CRC21};
use super::header_bits::HeaderBits;
use super::stuffing::Stuffer;

/// The longest frame (extended identifier, 64 bytes, every stuff bit) has 733 bits.
const WORDS: usize = 12;

/// Every bit of one frame from SOF to the end of EOF, including stuff bits, CRC and an acknowledged
/// ACK slot. `true` is recessive.
///
/// For tools and tests: the bus needs only the lengths, which [`FrameTiming`](super::FrameTiming)
/// finds faster.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct WireFrame {
    bits: [u64; WORDS],
    length: usize,
    data_phase: Range<usize>,
    crc: u32,
    stuff_bits: usize,
}

impl WireFrame {
    /// Encodes a frame.
    #[must_use]
    pub fn new(frame: &CanFrame) -> Self {
        let mut wire =
            Self { bits: [0; WORDS], length: 0, data_phase: 0..0, crc: 0, stuff_bits: 0 };
        match frame.kind() {
            FrameKind::Fd { brs, .. } => wire.encode_fd(frame, brs),
            FrameKind::Data | FrameKind::Remote => wire.encode_classic(frame),
        }
        wire.push(false); // ACK slot, driven by the receivers
        wire.push_all(0xFF, 8); // ACK delimiter and EOF
        wire
    }

    /// Number of bits.
    #[must_use]
    pub fn len(&self) -> usize {
        self.length
    }

    /// Always false: the shortest frame has 44 bits.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.length == 0
    }

    /// The bits in order of time.
    pub fn bits(&self) -> impl Iterator<Item = bool> + '_ {
        (0..self.length).map(|i| self.bits[i / 64] >> (i % 64) & 1 == 1)
    }

    /// Positions of the bits counted at the data bit rate; empty without bit rate switching.
    #[must_use]
    pub fn data_phase(&self) -> Range<usize> {
        self.data_phase.clone()
    }

    /// The CRC sequence: 15, 17 or 21 bits.
    #[must_use]
    pub fn crc(&self) -> u32 {
        self.crc
    }

    /// Number of dynamic stuff bits, including those in the CRC of a classic frame.
    #[must_use]
    pub fn stuff_bits(&self) -> usize {
        self.stuff_bits
    }

    fn encode_classic(&mut self, frame: &CanFrame) {
        let mut crc = CRC15.start();
        let mut stuffer = Stuffer::new();
        for bit in stuffed_part(frame) {
            crc = CRC15.bit(crc, bit);
            self.push_stuffed(&mut stuffer, bit);
        }
        self.crc = crc;
        for i in (0..15).rev() {
            self.push_stuffed(&mut stuffer, crc >> i & 1 == 1);
        }
        if let Some(last) = stuffer.due() {
            self.push(last);
            self.stuff_bits += 1;
        }
        self.push(true); // CRC delimiter
    }

    fn encode_fd(&mut self, frame: &CanFrame, brs: bool) {
        let header = HeaderBits::of(frame);
        let (crc, width): (&BitCrc, u32) =
            if frame.data().len() <= 16 { (&CRC17, 17) } else { (&CRC21, 21) };
        let mut stuffer = Stuffer::new();
        let mut switch = 0;
        for (i, bit) in stuffed_part(frame).enumerate() {
            self.push_stuffed(&mut stuffer, bit);
            if i + 1 == header.before_switch as usize {
                switch = self.length;
            }
        }
        let mut register = self.bits().fold(crc.start(), |r, bit| crc.bit(r, bit));
        let stuff_count = stuff_count_field(self.stuff_bits);
        for i in (0..4).rev() {
            register = crc.bit(register, stuff_count >> i & 1 == 1);
        }
        self.crc = register;
        let field = u64::from(stuff_count) << width | u64::from(register);
        for i in 0..width + 4 {
            if i % 4 == 0 {
                self.push_fixed_stuff();
            }
            self.push(field >> (width + 3 - i) & 1 == 1);
        }
        self.push(true); // CRC delimiter
        if brs {
            self.data_phase = switch..self.length;
        }
    }

    fn push_stuffed(&mut self, stuffer: &mut Stuffer, bit: bool) {
        if let Some(stuff) = stuffer.before(bit) {
            self.push(stuff);
            self.stuff_bits += 1;
        }
        self.push(bit);
    }

    fn push_fixed_stuff(&mut self) {
        let last = self.length.wrapping_sub(1);
        let level = self.bits.get(last / 64).is_some_and(|word| word >> (last % 64) & 1 == 1);
        self.push(!level);
    }

    fn push(&mut self, bit: bool) {
        if let Some(word) = self.bits.get_mut(self.length / 64) {
            *word |= u64::from(bit) << (self.length % 64);
            self.length += 1;
        }
    }

    fn push_all(&mut self, bits: u32, count: u32) {
        for i in (0..count).rev() {
            self.push(bits >> i & 1 == 1);
        }
    }
}

/// SOF to the end of the data field, without stuff bits.
fn stuffed_part(frame: &CanFrame) -> impl Iterator<Item = bool> + '_ {
    let header = HeaderBits::of(frame);
    let front = (0..header.length).map(move |i| header.bits >> (header.length - 1 - i) & 1 == 1);
    let data = frame.data().iter().flat_map(|&byte| (0..8).rev().map(move |i| byte >> i & 1 == 1));
    front.chain(data)
}

/// Stuff bits modulo 8 in Gray code, and the bit that makes the parity even.
fn stuff_count_field(stuff_bits: usize) -> u32 {
    let count = (stuff_bits % 8) as u32;
    let gray = count ^ count >> 1;
    gray << 1 | gray.count_ones() & 1
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stuff_count_field_matches_standard() {
        let fields: Vec<u32> = (0..9).map(stuff_count_field).collect();
        assert_eq!(
            fields,
            [0b0000, 0b0011, 0b0110, 0b0101, 0b1100, 0b1111, 0b1010, 0b1001, 0b0000]
        );
    }
}
