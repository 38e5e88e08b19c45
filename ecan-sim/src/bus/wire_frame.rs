//! The bit sequence of a frame as a logic analyser shows it: header, CRCs, dynamic bit stuffing, and the key of
//! arbitration.

use core::ops::Range;

use ecan_protocol::can::{CanFrame, FrameKind};

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

/// The last level on the wire and its run length: `level * 5 + run - 1`.
///
/// The stuff bit after a run of five is inserted together with the next bit: it belongs to the
/// phase of that bit, and an FD frame whose data field ends in such a run has none.
type State = u8;

const RECESSIVE_IDLE: State = 5;

const fn step(state: State, bit: bool) -> (u8, State) {
    let mut inserted = 0;
    let mut level = state >= 5;
    let mut run = state % 5 + 1;
    if run == 5 {
        inserted = 1;
        level = !level;
        run = 1;
    }
    run = if bit == level { run + 1 } else { 1 };
    (inserted, bit as u8 * 5 + run - 1)
}

/// Number of stuff bits (high nibble) and next state (low nibble) for eight bits in each state.
static BYTE_STEPS: [[u8; 256]; 10] = table(false);
/// The same for one to seven bits, with a leading 1.
static PART_STEPS: [[u8; 256]; 10] = table(true);

/// The entry for the lowest `length` bits.
const fn steps(mut state: State, bits: usize, length: u32) -> u8 {
    let mut total = 0;
    let mut position = length;
    while position > 0 {
        position -= 1;
        let (inserted, next) = step(state, bits >> position & 1 == 1);
        total += inserted;
        state = next;
    }
    total << 4 | state
}

const fn table(is_part: bool) -> [[u8; 256]; 10] {
    let mut table = [[0; 256]; 10];
    let mut state = 0;
    while state < 10 {
        let mut bits = if is_part { 2 } else { 0 };
        while bits < 256 {
            let length = if is_part { (bits as u32).ilog2() } else { 8 };
            table[state][bits] = steps(state as State, bits, length);
            bits += 1;
        }
        state += 1;
    }
    table
}

/// Counts the stuff bits of a bit stream that starts with SOF on an idle bus.
#[derive(Clone, Copy, Debug)]
pub(super) struct StuffCounter {
    state: State,
    count: u32,
}

impl StuffCounter {
    pub(super) const fn new() -> Self {
        Self { state: RECESSIVE_IDLE, count: 0 }
    }

    /// Number of stuff bits so far, without a pending one.
    pub(super) const fn count(&self) -> u32 {
        self.count
    }

    /// Returns whether the stream ends in five equal bits.
    pub(super) const fn is_due(&self) -> bool {
        self.state % 5 == 4
    }

    #[inline]
    pub(super) fn byte(&mut self, byte: u8) {
        // infallible: every entry's low nibble is a state below 10
        self.apply(BYTE_STEPS[usize::from(self.state)][usize::from(byte)]);
    }

    #[inline]
    fn apply(&mut self, entry: u8) {
        self.count += u32::from(entry >> 4);
        self.state = entry & 0xF;
    }

    /// The lowest `length` bits of `bits`, the most significant of them first.
    #[inline]
    pub(super) fn bits(&mut self, bits: u64, length: u32) {
        let part = length % 8;
        let mut left = length - part;
        if part > 0 {
            let marked = 1 << part | (bits >> left) as u8 & ((1 << part) - 1);
            // infallible: as above
            self.apply(PART_STEPS[usize::from(self.state)][usize::from(marked)]);
        }
        while left > 0 {
            left -= 8;
            self.byte((bits >> left) as u8);
        }
    }
}

/// Inserts stuff bits: one bit in, one or two out.
#[derive(Clone, Copy, Debug)]
pub(super) struct Stuffer {
    state: State,
}

impl Stuffer {
    pub(super) const fn new() -> Self {
        Self { state: RECESSIVE_IDLE }
    }

    /// The stuff bit due before `bit`, if any.
    pub(super) fn before(&mut self, bit: bool) -> Option<bool> {
        let due = self.due();
        self.state = step(self.state, bit).1;
        due
    }

    /// The stuff bit that would follow now.
    pub(super) fn due(&self) -> Option<bool> {
        (self.state % 5 == 4).then_some(self.state < 5)
    }
}

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

/// One CRC of `WIDTH` bits, with its byte table.
pub(super) struct BitCrc {
    width: u32,
    polynomial: u32,
    initial: u32,
    table: [u32; 256],
}

impl BitCrc {
    const fn new(width: u32, polynomial: u32, initial: u32) -> Self {
        let mut table = [0; 256];
        let mut byte = 0;
        while byte < 256 {
            let mut register = (byte as u32) << (width - 8);
            let mut bit = 0;
            while bit < 8 {
                register = shift(register, width, polynomial);
                bit += 1;
            }
            table[byte] = register;
            byte += 1;
        }
        Self { width, polynomial, initial, table }
    }

    pub(super) const fn start(&self) -> u32 {
        self.initial
    }

    pub(super) const fn bit(&self, register: u32, bit: bool) -> u32 {
        let mixed = register ^ ((bit as u32) << (self.width - 1));
        shift(mixed, self.width, self.polynomial)
    }

    /// Adds eight bits, the most significant first.
    #[inline]
    pub(super) const fn byte(&self, register: u32, byte: u8) -> u32 {
        let index = ((register >> (self.width - 8)) as u8) ^ byte;
        ((register << 8) & mask(self.width)) ^ self.table[index as usize]
    }
}

const fn mask(width: u32) -> u32 {
    (1 << width) - 1
}

const fn shift(register: u32, width: u32, polynomial: u32) -> u32 {
    let out = register >> (width - 1) & 1;
    let moved = (register << 1) & mask(width);
    if out == 1 { moved ^ polynomial } else { moved }
}

/// CRC of classic frames: over the unstuffed bits from SOF to the data field.
pub(super) static CRC15: BitCrc = BitCrc::new(15, 0x4599, 0);
/// CRC of FD frames of up to 16 data bytes: over stuffed bits and the stuff count.
pub(super) static CRC17: BitCrc = BitCrc::new(17, 0x1685B, 1 << 16);
/// CRC of FD frames of more than 16 data bytes: over stuffed bits and the stuff count.
pub(super) static CRC21: BitCrc = BitCrc::new(21, 0x10_2899, 1 << 20);

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

    fn count(text: &str) -> (u32, bool) {
        let mut counter = StuffCounter::new();
        for c in text.chars() {
            counter.bits(u64::from(c == '1'), 1);
        }
        (counter.count(), counter.is_due())
    }

    #[test]
    fn stuff_bit_is_counted_with_sixth_bit() {
        assert_eq!(count("00000"), (0, true));
        assert_eq!(count("000000"), (1, false));
        assert_eq!(count("000001"), (1, false));
    }

    #[test]
    fn stuff_bit_counts_for_next_run() {
        // 00000 [1] 1111 [0] 0000 [1]
        assert_eq!(count("0000011110000"), (2, true));
        assert_eq!(count("00000111100001"), (3, false));
    }

    #[test]
    fn bytes_and_bits_agree_in_every_alignment() {
        let pattern = 0x0F83_E0FF_0000_7C1Fu64;
        for cut in 0..64 {
            let mut one = StuffCounter::new();
            let mut two = StuffCounter::new();
            one.bits(pattern, 64);
            two.bits(pattern >> cut, 64 - cut);
            two.bits(pattern & ((1 << cut) - 1), cut);
            assert_eq!(one.count(), two.count());
            assert_eq!(one.is_due(), two.is_due());
        }
    }

    #[test]
    fn stuffer_and_counter_agree() {
        let pattern = 0x0F83_E0FF_0000_7C1Fu64;
        let mut counter = StuffCounter::new();
        let mut stuffer = Stuffer::new();
        counter.bits(pattern, 64);
        let inserted =
            (0..64).rev().filter(|i| stuffer.before(pattern >> i & 1 == 1).is_some()).count();
        assert_eq!(inserted as u32, counter.count());
        assert_eq!(stuffer.due().is_some(), counter.is_due());
    }

    /// The check values of the CRC catalogue refer to nine digits with start value zero.
    #[test]
    fn catalogue_check_values_match() {
        for (crc, check) in [(&CRC15, 0x059E), (&CRC17, 0x0_4F03), (&CRC21, 0x0E_D841)] {
            let bytewise = b"123456789".iter().fold(0, |r, &b| crc.byte(r, b));
            let bitwise = b"123456789"
                .iter()
                .flat_map(|&b| (0..8).rev().map(move |i| b >> i & 1 == 1))
                .fold(0, |r, bit| crc.bit(r, bit));
            assert_eq!(bytewise, check);
            assert_eq!(bitwise, check);
        }
    }

    #[test]
    fn fd_crcs_start_with_highest_bit_set() {
        assert_eq!(CRC15.start(), 0);
        assert_eq!(CRC17.start(), 0x1_0000);
        assert_eq!(CRC21.start(), 0x10_0000);
    }
}
