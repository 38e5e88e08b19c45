//! CRC by carry-less multiplication (PCLMULQDQ), with [`wide`] the only unsafe code of this crate.
//!
//! The message is a polynomial over GF(2), its first byte the highest, and its CRC is
//! `message * x^16 mod P`. Of 16 bytes that stand `n` bits above the end, each half is multiplied by
//! a power of x reduced mod P: `high * (x^(n+80) mod P) + low * (x^(n+16) mod P)`. Such a product of
//! 64 by 16 bits has at most 79 bits, and no block waits for another. The sum of them all is reduced
//! once. Long inputs are first folded: a remainder of 128 bits comes down by a fixed distance onto
//! the next block, several of them side by side to hide the multiplier's latency.

use core::arch::x86_64::{
    __cpuid, __cpuid_count, __m128i, _mm_clmulepi64_si128, _mm_cvtsi128_si32, _mm_loadu_si128,
    _mm_set_epi8, _mm_set_epi64x, _mm_set1_epi8, _mm_setzero_si128, _mm_shuffle_epi8,
    _mm_slli_si128, _mm_sub_epi8, _mm_xor_si128, _xgetbv,
};
use core::sync::atomic::{AtomicU8, Ordering};

use super::POLYNOMIAL;

mod wide;

/// Shortest input of [`crc16`], that of the smallest packet.
pub(super) const MIN_BYTES: usize = 4;

/// Remainders that run side by side on long inputs.
const LANES: usize = 4;

/// Blocks of 16 bytes, after the first, that are summed without folding.
const DIRECT_BLOCKS: usize = 8;

/// From this many blocks after the first on it pays to take two at once.
const WIDE_BLOCKS: usize = 3;

/// x^`exponent` mod P.
const fn power(exponent: usize) -> u64 {
    let mut value: u16 = 1;
    let mut i = 0;
    while i < exponent {
        value = if value & 0x8000 != 0 { value << 1 ^ POLYNOMIAL } else { value << 1 };
        i += 1;
    }
    value as u64
}

/// Powers that bring the halves of 16 bytes down to the CRC, with `DIRECT_BLOCKS` to 0 blocks after
/// them: for the low half, then for the high one.
static POWERS: [[u64; 2]; DIRECT_BLOCKS + 1] = {
    let mut powers = [[0; 2]; DIRECT_BLOCKS + 1];
    let mut i = 0;
    while i <= DIRECT_BLOCKS {
        let below = 128 * (DIRECT_BLOCKS - i);
        powers[i] = [power(below + 16), power(below + 80)];
        i += 1;
    }
    powers
};

/// The quotient of x^80 by P without its highest term, x^64.
const fn quotient() -> u64 {
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
const ABSENT: u8 = 1;
/// PCLMULQDQ and SSSE3.
const PRESENT: u8 = 2;
/// AVX2 and VPCLMULQDQ besides.
const WIDE: u8 = 3;
static AVAILABLE: AtomicU8 = AtomicU8::new(UNKNOWN);

#[inline]
pub(super) fn is_available() -> bool {
    if cfg!(all(target_feature = "pclmulqdq", target_feature = "ssse3")) {
        return true;
    }
    match AVAILABLE.load(Ordering::Relaxed) {
        UNKNOWN => detect() >= PRESENT,
        known => known >= PRESENT,
    }
}

#[inline]
fn is_wide() -> bool {
    match AVAILABLE.load(Ordering::Relaxed) {
        UNKNOWN => detect() == WIDE,
        known => known == WIDE,
    }
}

#[cold]
#[inline(never)]
fn detect() -> u8 {
    const PCLMULQDQ: u32 = 1 << 1;
    const SSSE3: u32 = 1 << 9;
    let features = __cpuid(1).ecx;
    let level = if features & PCLMULQDQ == 0 || features & SSSE3 == 0 {
        ABSENT
    } else if has_wide() {
        WIDE
    } else {
        PRESENT
    };
    AVAILABLE.store(level, Ordering::Relaxed);
    level
}

/// True if the processor has AVX2 and VPCLMULQDQ, and the system keeps their registers.
fn has_wide() -> bool {
    const OSXSAVE: u32 = 1 << 27;
    const AVX: u32 = 1 << 28;
    const AVX2: u32 = 1 << 5;
    const VPCLMULQDQ: u32 = 1 << 10;
    const SSE_AND_AVX_STATE: u64 = 0b110;
    const EXTENDED_FEATURES: u32 = 7;
    let features = __cpuid(1).ecx;
    if features & OSXSAVE == 0 || features & AVX == 0 || __cpuid(0).eax < EXTENDED_FEATURES {
        return false;
    }
    // SAFETY: OSXSAVE says that the instruction may be used.
    let kept = unsafe { _xgetbv(0) };
    let extended = __cpuid_count(EXTENDED_FEATURES, 0);
    kept & SSE_AND_AVX_STATE == SSE_AND_AVX_STATE
        && extended.ebx & AVX2 != 0
        && extended.ecx & VPCLMULQDQ != 0
}

/// Takes the instructions for absent from now on, or asks the processor anew.
pub(super) fn pretend_absent(on: bool) {
    AVAILABLE.store(if on { ABSENT } else { UNKNOWN }, Ordering::Relaxed);
}

/// The bytes as they lie in memory.
#[inline]
#[target_feature(enable = "sse2")]
fn load(bytes: &[u8; 16]) -> __m128i {
    // SAFETY: 16 bytes can be read after the reference, and the load needs no alignment.
    unsafe { _mm_loadu_si128(bytes.as_ptr().cast()) }
}

/// The first `count` (1 to 16) of 16 bytes as a polynomial, the first byte highest.
#[inline]
#[target_feature(enable = "ssse3")]
fn polynomial_of(bytes: __m128i, count: usize) -> __m128i {
    let places = _mm_set_epi8(15, 14, 13, 12, 11, 10, 9, 8, 7, 6, 5, 4, 3, 2, 1, 0);
    // Where nothing is left to take, the index is negative, which yields zero.
    let indices = _mm_sub_epi8(_mm_set1_epi8(count as i8 - 1), places);
    _mm_shuffle_epi8(bytes, indices)
}

/// High half by high power plus low half by low power.
#[inline]
#[target_feature(enable = "pclmulqdq")]
fn bring_down(value: __m128i, powers: __m128i) -> __m128i {
    let high = _mm_clmulepi64_si128::<0x11>(value, powers);
    let low = _mm_clmulepi64_si128::<0x00>(value, powers);
    _mm_xor_si128(high, low)
}

/// A polynomial of at most 80 bits mod P.
#[inline]
#[target_feature(enable = "pclmulqdq")]
fn reduce(sum: __m128i) -> u16 {
    // Barrett: the quotient by P from the upper 64 bits and the quotient of x^80, whose highest
    // term is the upper bits themselves.
    let constants = const { [quotient() as i64, POLYNOMIAL as i64] };
    let constants = _mm_set_epi64x(constants[1], constants[0]);
    let upper = _mm_slli_si128::<6>(sum);
    let times = _mm_xor_si128(upper, _mm_clmulepi64_si128::<0x01>(upper, constants));
    let product = _mm_clmulepi64_si128::<0x11>(times, constants);
    _mm_cvtsi128_si32(_mm_xor_si128(sum, product)) as u16
}

/// `remainder` brought down by the distance of `powers` onto `next`.
#[inline]
#[target_feature(enable = "pclmulqdq")]
fn fold(remainder: __m128i, powers: __m128i, next: __m128i) -> __m128i {
    _mm_xor_si128(bring_down(remainder, powers), next)
}

/// The powers with which [`fold`] goes over `blocks` blocks.
#[inline]
#[target_feature(enable = "sse2")]
fn over<const BLOCKS: usize>() -> __m128i {
    let powers = const { [power(128 * BLOCKS) as i64, power(128 * BLOCKS + 64) as i64] };
    _mm_set_epi64x(powers[1], powers[0])
}

/// The sum of `first` and the blocks after it, at most [`DIRECT_BLOCKS`] of them.
#[inline]
#[target_feature(enable = "pclmulqdq,ssse3")]
fn sum_of(first: __m128i, blocks: &[[u8; 16]]) -> __m128i {
    let powers = POWERS.get(DIRECT_BLOCKS.wrapping_sub(blocks.len())..).unwrap_or_default();
    let Some((&[low, high], powers)) = powers.split_first() else {
        return first;
    };
    let mut sum = bring_down(first, _mm_set_epi64x(high as i64, low as i64));
    for (block, &[low, high]) in blocks.iter().zip(powers) {
        let block = polynomial_of(load(block), 16);
        sum = _mm_xor_si128(sum, bring_down(block, _mm_set_epi64x(high as i64, low as i64)));
    }
    sum
}

/// CRC-16/CCITT-FALSE of `data`; of no meaning for fewer than [`MIN_BYTES`] bytes, which callers
/// never pass.
#[target_feature(enable = "pclmulqdq,ssse3")]
pub(super) fn crc16(data: &[u8]) -> u16 {
    let Some(first) = data.first_chunk::<16>() else {
        return short(data);
    };
    // Zeros in front of a polynomial change nothing, so the odd bytes go first; the start value is
    // added to the first two bytes of the message.
    let odd = (data.len() - 1) % 16 + 1;
    let opening = _mm_xor_si128(load(first), _mm_set_epi64x(0, 0xFFFF));
    let mut head = polynomial_of(opening, odd);
    let mut blocks = data.get(odd..).unwrap_or_default().as_chunks::<16>().0;
    if odd == 1 {
        // The start value reaches into the next block.
        if let Some((next, rest)) = blocks.split_first() {
            let next = _mm_xor_si128(load(next), _mm_set_epi64x(0, 0xFF));
            head = fold(head, over::<1>(), polynomial_of(next, 16));
            blocks = rest;
        }
    }
    match blocks.len() {
        0..WIDE_BLOCKS => reduce(sum_of(head, blocks)),
        // SAFETY: the processor has the instructions, as just checked.
        WIDE_BLOCKS..=DIRECT_BLOCKS if is_wide() => unsafe { wide::direct(head, blocks) },
        WIDE_BLOCKS..=DIRECT_BLOCKS => reduce(sum_of(head, blocks)),
        // SAFETY: as above.
        _ if is_wide() => unsafe { wide::long(head, blocks) },
        _ => long(head, blocks),
    }
}

/// The same for a head and many blocks after it.
#[inline(never)]
#[target_feature(enable = "pclmulqdq,ssse3")]
fn long(head: __m128i, blocks: &[[u8; 16]]) -> u16 {
    // The head stands one block above the first, where the last lane was before it.
    let mut lanes = [_mm_setzero_si128(); LANES];
    lanes[LANES - 1] = head;
    let (groups, rest) = blocks.as_chunks::<LANES>();
    for group in groups {
        for (lane, block) in lanes.iter_mut().zip(group) {
            *lane = fold(*lane, over::<LANES>(), polynomial_of(load(block), 16));
        }
    }
    let [first, second, third, last] = lanes;
    let first = fold(fold(first, over::<1>(), second), over::<1>(), third);
    reduce(sum_of(fold(first, over::<1>(), last), rest))
}

/// The same for 4 to 15 bytes, read as two parts that may overlap.
#[inline(never)]
#[target_feature(enable = "pclmulqdq,ssse3")]
fn short(data: &[u8]) -> u16 {
    let bits = 8 * data.len() as u32;
    let message = if let (Some(&first), Some(&last)) = (data.first_chunk(), data.last_chunk()) {
        u128::from(u64::from_be_bytes(first)) << (bits - 64) | u128::from(u64::from_be_bytes(last))
    } else if let (Some(&first), Some(&last)) = (data.first_chunk(), data.last_chunk()) {
        u128::from(u32::from_be_bytes(first)) << (bits - 32) | u128::from(u32::from_be_bytes(last))
    } else {
        0
    };
    let message = message ^ 0xFFFF << (bits - 16);
    reduce(sum_of(_mm_set_epi64x((message >> 64) as i64, message as i64), &[]))
}

#[cfg(test)]
mod tests {
    extern crate std;

    use super::super::{crc16, crc16_portable};
    use super::{ABSENT, AVAILABLE, Ordering, PRESENT, detect};
    use std::vec::Vec;

    /// Processors with VPCLMULQDQ would otherwise never take the other way.
    #[test]
    fn every_level_gives_the_same() {
        let level = detect();
        let data: Vec<u8> = (0..1000_u32).map(|i| ((i * i) >> 3) as u8).collect();
        for level in (PRESENT..=level).chain([ABSENT]) {
            AVAILABLE.store(level, Ordering::Relaxed);
            for length in 0..data.len() {
                let data = &data[..length];
                assert_eq!(crc16(data), crc16_portable(data), "level {level}, {length} bytes");
            }
        }
        AVAILABLE.store(level, Ordering::Relaxed);
    }
}
