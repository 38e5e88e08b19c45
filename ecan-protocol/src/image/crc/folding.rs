//! CRC by carry-less multiplication. The unsafe code of this crate is in the kernels and in their dispatch.
//!
//! The message is a polynomial over GF(2), its first byte the highest, and its CRC is
//! `message * x^16 mod P`. Of 16 bytes that stand `n` bits above the end, each half is multiplied by
//! a power of x reduced mod P: `high * (x^(n+80) mod P) + low * (x^(n+16) mod P)`. Such a product of
//! 64 by 16 bits has at most 79 bits, and no block waits for another. The sum of them all is reduced
//! once. Long inputs are first folded: a remainder of 128 bits comes down by a fixed distance onto
//! the next block, several of them in parallel to hide the multiplier's latency.
//!
//! The instructions of each processor are in a file of its name.

#[cfg(target_arch = "aarch64")]
use super::aarch64 as processor;
use super::shared::power;
#[cfg(target_arch = "x86_64")]
use super::x86_64 as processor;
use processor::{Block, add, bring_down, from_halves, load, polynomial_of, reduce};

/// Remainders that are folded in parallel on long inputs.
const LANES: usize = 4;

/// Blocks of 16 bytes, after the first, that are summed without folding.
pub(super) const DIRECT_BLOCKS: usize = 8;

/// Powers that bring the halves of 16 bytes down to the CRC, with `DIRECT_BLOCKS` to 0 blocks after
/// them: for the low half, then for the high one.
pub(super) static POWERS: [[u64; 2]; DIRECT_BLOCKS + 1] = {
    let mut powers = [[0; 2]; DIRECT_BLOCKS + 1];
    let mut i = 0;
    while i <= DIRECT_BLOCKS {
        let below = 128 * (DIRECT_BLOCKS - i);
        powers[i] = [power(below + 16), power(below + 80)];
        i += 1;
    }
    powers
};

/// `remainder` brought down by the distance of `powers` onto `next`.
#[inline]
#[cfg_attr(target_arch = "x86_64", target_feature(enable = "pclmulqdq,ssse3"))]
#[cfg_attr(target_arch = "aarch64", target_feature(enable = "neon,aes"))]
pub(super) fn fold(remainder: Block, powers: Block, next: Block) -> Block {
    add(bring_down(remainder, powers), next)
}

/// The powers with which [`fold`] goes over `blocks` blocks.
#[inline]
#[cfg_attr(target_arch = "x86_64", target_feature(enable = "pclmulqdq,ssse3"))]
#[cfg_attr(target_arch = "aarch64", target_feature(enable = "neon,aes"))]
pub(super) fn over<const BLOCKS: usize>() -> Block {
    let powers = const { [power(128 * BLOCKS), power(128 * BLOCKS + 64)] };
    from_halves(powers[0], powers[1])
}

/// The sum of `first` and the blocks after it, at most [`DIRECT_BLOCKS`] of them.
#[inline]
#[cfg_attr(target_arch = "x86_64", target_feature(enable = "pclmulqdq,ssse3"))]
#[cfg_attr(target_arch = "aarch64", target_feature(enable = "neon,aes"))]
pub(super) fn sum_of(first: Block, blocks: &[[u8; 16]]) -> Block {
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

/// The CRC of a head and many blocks after it.
#[inline(never)]
#[cfg_attr(target_arch = "x86_64", target_feature(enable = "pclmulqdq,ssse3"))]
#[cfg_attr(target_arch = "aarch64", target_feature(enable = "neon,aes"))]
pub(super) fn long(head: Block, blocks: &[[u8; 16]]) -> u16 {
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

/// The CRC of 4 to 15 bytes, read as two parts that may overlap.
#[inline(never)]
#[cfg_attr(target_arch = "x86_64", target_feature(enable = "pclmulqdq,ssse3"))]
#[cfg_attr(target_arch = "aarch64", target_feature(enable = "neon,aes"))]
pub(super) fn short(data: &[u8]) -> u16 {
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
