//! CRC by carry-less multiplication (PCLMULQDQ), the only unsafe code of this crate.
//!
//! The message is a polynomial over GF(2), its first byte the highest. A 128 bit remainder `r`
//! that stands `n` bits above the next block is brought down by
//! `r * x^n = high * (x^(n+64) mod P) + low * (x^n mod P)`; the products of 64 by 16 bits fit
//! 128 bits again. On long inputs several remainders run side by side to hide the multiplier's
//! latency.

use core::arch::x86_64::{
    __cpuid, __m128i, _mm_clmulepi64_si128, _mm_cvtsi128_si64, _mm_loadu_si128, _mm_set_epi8,
    _mm_set_epi64x, _mm_setzero_si128, _mm_shuffle_epi8, _mm_unpackhi_epi64, _mm_xor_si128,
};
use core::sync::atomic::{AtomicU8, Ordering};

use super::POLYNOMIAL;

/// Shortest input of [`crc16`].
pub(super) const MIN_BYTES: usize = 16;

/// Remainders that run side by side on long inputs.
const LANES: usize = 4;

/// From this many blocks of 16 bytes on that pays.
const WIDE_BLOCKS: usize = 8;

/// x^`exponent` mod P.
const fn power(exponent: u32) -> u64 {
    let mut value: u16 = 1;
    let mut i = 0;
    while i < exponent {
        value = if value & 0x8000 != 0 { value << 1 ^ POLYNOMIAL } else { value << 1 };
        i += 1;
    }
    value as u64
}

/// The quotient of x^64 by P, 49 bits.
const fn quotient() -> u64 {
    let divisor = 1u128 << 16 | POLYNOMIAL as u128;
    let mut rest = 1u128 << 64;
    let mut quotient = 0;
    let mut shift = 48;
    loop {
        if rest >> (16 + shift) & 1 != 0 {
            quotient |= 1 << shift;
            rest ^= divisor << shift;
        }
        if shift == 0 {
            return quotient;
        }
        shift -= 1;
    }
}

const UNKNOWN: u8 = 0;
const ABSENT: u8 = 1;
const PRESENT: u8 = 2;
static AVAILABLE: AtomicU8 = AtomicU8::new(UNKNOWN);

/// Whether the processor has PCLMULQDQ and SSSE3. Asks it once.
#[inline]
pub(super) fn is_available() -> bool {
    if cfg!(all(target_feature = "pclmulqdq", target_feature = "ssse3")) {
        return true;
    }
    match AVAILABLE.load(Ordering::Relaxed) {
        UNKNOWN => detect(),
        known => known == PRESENT,
    }
}

#[cold]
fn detect() -> bool {
    const PCLMULQDQ: u32 = 1 << 1;
    const SSSE3: u32 = 1 << 9;
    let features = __cpuid(1).ecx;
    let present = features & PCLMULQDQ != 0 && features & SSSE3 != 0;
    AVAILABLE.store(if present { PRESENT } else { ABSENT }, Ordering::Relaxed);
    present
}

/// Takes the instructions for absent from now on, or asks the processor anew.
pub(super) fn pretend_absent(on: bool) {
    AVAILABLE.store(if on { ABSENT } else { UNKNOWN }, Ordering::Relaxed);
}

/// The 16 bytes as a polynomial, the first byte highest.
#[inline]
#[target_feature(enable = "ssse3")]
fn load(bytes: &[u8; 16]) -> __m128i {
    let reverse = _mm_set_epi8(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15);
    // SAFETY: 16 bytes can be read behind the reference, and the load needs no alignment.
    let raw = unsafe { _mm_loadu_si128(bytes.as_ptr().cast()) };
    _mm_shuffle_epi8(raw, reverse)
}

/// `remainder` brought down by the distance whose powers `powers` holds, plus `next`.
#[inline]
#[target_feature(enable = "pclmulqdq")]
fn fold(remainder: __m128i, powers: __m128i, next: __m128i) -> __m128i {
    let high = _mm_clmulepi64_si128::<0x11>(remainder, powers);
    let low = _mm_clmulepi64_si128::<0x00>(remainder, powers);
    _mm_xor_si128(_mm_xor_si128(high, low), next)
}

/// `remainder * x^16 mod P`.
#[inline]
#[target_feature(enable = "pclmulqdq")]
fn reduce(remainder: __m128i) -> u16 {
    // The upper half comes down by 64 bits; both are then 16 bits above the result, so that
    // at most 80 bits remain.
    let step = _mm_set_epi64x(1 << 16, const { power(80) as i64 });
    let high = _mm_clmulepi64_si128::<0x01>(remainder, step);
    let low = _mm_clmulepi64_si128::<0x10>(remainder, step);
    let rest = _mm_xor_si128(high, low);
    // The 16 bits above bit 63 come down in turn.
    let tail = _mm_set_epi64x(0, const { power(64) as i64 });
    let rest = _mm_xor_si128(rest, _mm_clmulepi64_si128::<0x01>(rest, tail));
    let value = _mm_cvtsi128_si64(rest) as u64;
    // Barrett: the quotient of the 64 bits by P, from their upper 48 and the quotient of x^64.
    let estimate = _mm_clmulepi64_si128::<0x00>(
        _mm_set_epi64x(0, (value >> 16) as i64),
        _mm_set_epi64x(0, const { quotient() as i64 }),
    );
    let low = _mm_cvtsi128_si64(estimate) as u64;
    let high = _mm_cvtsi128_si64(_mm_unpackhi_epi64(estimate, estimate)) as u64;
    let times = low >> 48 | high << 16;
    let product = _mm_clmulepi64_si128::<0x00>(
        _mm_set_epi64x(0, times as i64),
        _mm_set_epi64x(0, POLYNOMIAL as i64),
    );
    (value ^ _mm_cvtsi128_si64(product) as u64) as u16
}

/// The first `count` (1 to 15) of 16 bytes as a polynomial: `block` moved down by the others.
#[inline]
#[target_feature(enable = "ssse3")]
fn keep_first(block: __m128i, count: usize) -> __m128i {
    // A window that starts `16 - count` into this table moves that many bytes out below;
    // indices with the high bit set yield zeros.
    static WINDOW: [u8; 32] = {
        let mut window = [0x80; 32];
        let mut i = 0;
        while i < 16 {
            window[i] = i as u8;
            i += 1;
        }
        window
    };
    let start = 16 - (count & 15);
    // SAFETY: `start` is 1 to 16, so 16 bytes from there lie inside the 32 of the table.
    let indices = unsafe { _mm_loadu_si128(WINDOW.as_ptr().add(start).cast()) };
    _mm_shuffle_epi8(block, indices)
}

/// CRC-16/CCITT-FALSE of `data`; 0 for fewer than [`MIN_BYTES`] bytes, which callers never pass.
#[target_feature(enable = "pclmulqdq,ssse3")]
pub(super) fn crc16(data: &[u8]) -> u16 {
    let by_one = _mm_set_epi64x(const { power(128 + 64) as i64 }, const { power(128) as i64 });
    let Some(first) = data.first_chunk::<16>() else {
        return 0;
    };
    // Zeros in front of a polynomial change nothing, so the odd bytes go first; the start value is
    // added to the first two bytes of the message.
    let start = _mm_set_epi64x((0xFFFF_u64 << 48) as i64, 0);
    let opening = _mm_xor_si128(load(first), start);
    let odd = data.len() % 16;
    let (mut remainder, mut blocks) = if odd == 0 {
        let rest = data.get(16..).unwrap_or_default();
        (opening, rest.as_chunks::<16>().0)
    } else {
        let rest = data.get(odd..).unwrap_or_default();
        (keep_first(opening, odd), rest.as_chunks::<16>().0)
    };
    if odd == 1 {
        // The start value reaches into the next block, where its second byte is still due.
        if let Some((next, rest)) = blocks.split_first() {
            let carry = _mm_set_epi64x((0xFF_u64 << 56) as i64, 0);
            remainder = fold(remainder, by_one, _mm_xor_si128(load(next), carry));
            blocks = rest;
        }
    }
    if blocks.len() >= WIDE_BLOCKS {
        let by_lanes = _mm_set_epi64x(
            const { power(128 * LANES as u32 + 64) as i64 },
            const { power(128 * LANES as u32) as i64 },
        );
        // The remainder stands one block above the first, where the last lane was before it.
        let mut lanes = [_mm_setzero_si128(); LANES];
        lanes[LANES - 1] = remainder;
        let (groups, rest) = blocks.as_chunks::<LANES>();
        for group in groups {
            for (lane, block) in lanes.iter_mut().zip(group) {
                *lane = fold(*lane, by_lanes, load(block));
            }
        }
        remainder = lanes[0];
        for lane in lanes.iter().skip(1) {
            remainder = fold(remainder, by_one, *lane);
        }
        blocks = rest;
    }
    for block in blocks {
        remainder = fold(remainder, by_one, load(block));
    }
    reduce(remainder)
}
