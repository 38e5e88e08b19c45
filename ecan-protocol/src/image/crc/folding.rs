//! CRC by carry-less multiplication, with its modules the only unsafe code of this crate.
//!
//! The message is a polynomial over GF(2), its first byte the highest, and its CRC is
//! `message * x^16 mod P`. Of 16 bytes that stand `n` bits above the end, each half is multiplied by
//! a power of x reduced mod P: `high * (x^(n+80) mod P) + low * (x^(n+16) mod P)`. Such a product of
//! 64 by 16 bits has at most 79 bits, and no block waits for another. The sum of them all is reduced
//! once. Long inputs are first folded: a remainder of 128 bits comes down by a fixed distance onto
//! the next block, several of them in parallel to hide the multiplier's latency.
//!
//! The instructions of each processor are in a module of its name.

use super::POLYNOMIAL;

#[cfg(target_arch = "aarch64")]
mod aarch64;
mod level;
#[cfg(target_arch = "x86_64")]
mod wide;
#[cfg(target_arch = "x86_64")]
mod x86_64;

#[cfg(target_arch = "aarch64")]
use aarch64 as processor;
#[cfg(target_arch = "x86_64")]
use x86_64 as processor;

pub(super) use level::{is_available, pretend_absent};
use processor::{Block, add, bring_down, from_halves, load, polynomial_of, reduce};

/// Shortest input, that of the smallest packet.
const MIN_BYTES: usize = 4;

/// Remainders that are folded in parallel on long inputs.
const LANES: usize = 4;

/// Blocks of 16 bytes, after the first, that are summed without folding.
const DIRECT_BLOCKS: usize = 8;

/// From this many blocks after the first on it pays to take two at once.
#[cfg(target_arch = "x86_64")]
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

/// `remainder` brought down by the distance of `powers` onto `next`.
#[inline]
#[cfg_attr(target_arch = "x86_64", target_feature(enable = "pclmulqdq,ssse3"))]
#[cfg_attr(target_arch = "aarch64", target_feature(enable = "neon,aes"))]
fn fold(remainder: Block, powers: Block, next: Block) -> Block {
    add(bring_down(remainder, powers), next)
}

/// The powers with which [`fold`] goes over `blocks` blocks.
#[inline]
#[cfg_attr(target_arch = "x86_64", target_feature(enable = "pclmulqdq,ssse3"))]
#[cfg_attr(target_arch = "aarch64", target_feature(enable = "neon,aes"))]
fn over<const BLOCKS: usize>() -> Block {
    let powers = const { [power(128 * BLOCKS), power(128 * BLOCKS + 64)] };
    from_halves(powers[0], powers[1])
}

/// The sum of `first` and the blocks after it, at most [`DIRECT_BLOCKS`] of them.
#[inline]
#[cfg_attr(target_arch = "x86_64", target_feature(enable = "pclmulqdq,ssse3"))]
#[cfg_attr(target_arch = "aarch64", target_feature(enable = "neon,aes"))]
fn sum_of(first: Block, blocks: &[[u8; 16]]) -> Block {
    let powers = POWERS.get(DIRECT_BLOCKS.wrapping_sub(blocks.len())..).unwrap_or_default();
    let Some((&[low, high], powers)) = powers.split_first() else {
        return first;
    };
    let mut sum = bring_down(first, from_halves(low, high));
    for (block, &[low, high]) in blocks.iter().zip(powers) {
        let block = polynomial_of(load(block), 16);
        sum = add(sum, bring_down(block, from_halves(low, high)));
    }
    sum
}

/// CRC-16/CCITT-FALSE of `data`, unless it is too short or the processor has no instructions for it.
#[inline]
pub(super) fn crc16(data: &[u8]) -> Option<u16> {
    // SAFETY: the processor has the instructions, as just checked.
    (data.len() >= MIN_BYTES && is_available()).then(|| unsafe { folded(data) })
}

/// The same for [`MIN_BYTES`] and more.
#[cfg_attr(target_arch = "x86_64", target_feature(enable = "pclmulqdq,ssse3"))]
#[cfg_attr(target_arch = "aarch64", target_feature(enable = "neon,aes"))]
fn folded(data: &[u8]) -> u16 {
    let Some(first) = data.first_chunk::<16>() else {
        return short(data);
    };
    // Zeros in front of a polynomial change nothing, so the odd bytes go first; the start value is
    // added to the first two bytes of the message.
    let odd = (data.len() - 1) % 16 + 1;
    let opening = add(load(first), from_halves(0xFFFF, 0));
    let mut head = polynomial_of(opening, odd);
    let mut blocks = data.get(odd..).unwrap_or_default().as_chunks::<16>().0;
    if odd == 1 {
        // The start value reaches into the next block.
        if let Some((next, rest)) = blocks.split_first() {
            let next = add(load(next), from_halves(0xFF, 0));
            head = fold(head, over::<1>(), polynomial_of(next, 16));
            blocks = rest;
        }
    }
    #[cfg(target_arch = "x86_64")]
    if blocks.len() >= WIDE_BLOCKS && processor::is_wide() {
        // SAFETY: the processor has the instructions, as just checked.
        return unsafe {
            if blocks.len() <= DIRECT_BLOCKS {
                wide::direct(head, blocks)
            } else {
                wide::long(head, blocks)
            }
        };
    }
    if blocks.len() <= DIRECT_BLOCKS { reduce(sum_of(head, blocks)) } else { long(head, blocks) }
}

/// The same for a head and many blocks after it.
#[inline(never)]
#[cfg_attr(target_arch = "x86_64", target_feature(enable = "pclmulqdq,ssse3"))]
#[cfg_attr(target_arch = "aarch64", target_feature(enable = "neon,aes"))]
fn long(head: Block, blocks: &[[u8; 16]]) -> u16 {
    // The head stands one block above the first, where the last lane was before it.
    let mut lanes = [from_halves(0, 0); LANES];
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
#[cfg_attr(target_arch = "x86_64", target_feature(enable = "pclmulqdq,ssse3"))]
#[cfg_attr(target_arch = "aarch64", target_feature(enable = "neon,aes"))]
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
    reduce(sum_of(from_halves(message as u64, (message >> 64) as u64), &[]))
}

#[cfg(test)]
mod tests {
    extern crate std;

    use super::super::{crc16, crc16_portable};
    use super::level;
    use std::vec::Vec;

    /// A processor would otherwise use its best level only.
    #[test]
    fn every_level_gives_the_same() {
        let data: Vec<u8> = (0..1000_u32).map(|i| ((i * i) >> 3) as u8).collect();
        let is_available = level::is_available();
        // Miri takes seconds for each length.
        let step = if cfg!(miri) { 61 } else { 1 };
        let tested = level::with_each_level(|level| {
            for length in (0..data.len()).step_by(step) {
                let data = &data[..length];
                assert_eq!(crc16(data), crc16_portable(data), "level {level}, {length} bytes");
            }
        });
        assert!(tested > usize::from(is_available), "{tested} levels");
        assert_eq!(level::is_available(), is_available);
    }
}
