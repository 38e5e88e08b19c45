//! What the kernels of all processors share: the polynomial, and the level of the instructions.

use core::sync::atomic::{AtomicU8, Ordering};

/// x^16 + x^12 + x^5 + 1 without its highest term.
pub(super) const POLYNOMIAL: u16 = 0x1021;

/// x^`exponent` mod P.
pub(super) const fn power(exponent: usize) -> u64 {
    let mut value: u16 = 1;
    let mut i = 0;
    while i < exponent {
        value = if value & 0x8000 != 0 { value << 1 ^ POLYNOMIAL } else { value << 1 };
        i += 1;
    }
    value as u64
}

/// The quotient of x^80 by P without its highest term, x^64.
pub(super) const fn quotient() -> u64 {
    let divisor = 1u128 << 16 | POLYNOMIAL as u128;
    // x^80 + x^64 * P, the rest when the highest term is taken.
    let mut rest = (POLYNOMIAL as u128) << 64;
    let mut quotient = 0;
    let mut shift = 64;
    while shift > 0 {
        shift -= 1;
        if rest >> (16 + shift) & 1 != 0 {
            quotient |= 1 << shift;
            rest ^= divisor << shift;
        }
    }
    quotient
}

const UNKNOWN: u8 = 0;
pub(super) const ABSENT: u8 = 1;
pub(super) const PRESENT: u8 = 2;
/// Level of the instructions that are used, detected once.
static LEVEL: AtomicU8 = AtomicU8::new(UNKNOWN);

/// Level of the processor, which `detect` finds out the first time.
#[inline]
pub(super) fn level(detect: fn() -> u8) -> u8 {
    match LEVEL.load(Ordering::Relaxed) {
        UNKNOWN => store(detect()),
        known => known,
    }
}

#[cold]
#[inline(never)]
fn store(level: u8) -> u8 {
    LEVEL.store(level, Ordering::Relaxed);
    level
}

/// Stops or resumes the use of the instructions.
pub(super) fn pretend_absent(on: bool) {
    LEVEL.store(if on { ABSENT } else { UNKNOWN }, Ordering::Relaxed);
}

/// Calls `test` with each level up to the highest of this processor, then returns their number.
#[cfg(test)]
pub(super) fn with_each_level(highest: u8, test: impl Fn(u8)) -> usize {
    store(highest);
    for level in ABSENT..=highest {
        LEVEL.store(level, Ordering::Relaxed);
        test(level);
    }
    LEVEL.store(highest, Ordering::Relaxed);
    usize::from(highest)
}
