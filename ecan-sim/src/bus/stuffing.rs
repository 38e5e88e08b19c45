//! Dynamic bit stuffing: after five equal bits the transmitter inserts their complement.

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

#[cfg(test)]
mod tests {
    use super::*;

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
}
