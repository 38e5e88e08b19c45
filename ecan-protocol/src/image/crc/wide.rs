//! CRC by two blocks at once (VPCLMULQDQ).

use core::arch::x86_64::{
    __m128i, __m256i, _mm_set_epi64x, _mm_setzero_si128, _mm_xor_si128,
    _mm256_broadcastsi128_si256, _mm256_castsi256_si128, _mm256_clmulepi64_epi128,
    _mm256_extracti128_si256, _mm256_loadu_si256, _mm256_set_epi8, _mm256_set_epi64x,
    _mm256_set_m128i, _mm256_setzero_si256, _mm256_shuffle_epi8, _mm256_xor_si256,
};

use super::folding::{DIRECT_BLOCKS, POWERS, fold, over, sum_of};
use super::x86_64::{bring_down, load as load_block, polynomial_of, reduce};

/// Pairs of remainders that run side by side.
const LANES: usize = 4;

#[inline]
#[target_feature(enable = "avx2")]
fn load(pair: &[[u8; 16]; 2]) -> __m256i {
    let reversed = _mm256_set_epi8(
        0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, //
        0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15,
    );
    // SAFETY: 32 bytes can be read after the reference, and the load needs no alignment.
    let bytes = unsafe { _mm256_loadu_si256(pair.as_ptr().cast()) };
    _mm256_shuffle_epi8(bytes, reversed)
}

/// High halves by high powers plus low halves by low powers.
#[inline]
#[target_feature(enable = "avx2,vpclmulqdq")]
fn bring_down_pair(pair: __m256i, powers: __m256i) -> __m256i {
    let high = _mm256_clmulepi64_epi128::<0x11>(pair, powers);
    let low = _mm256_clmulepi64_epi128::<0x00>(pair, powers);
    _mm256_xor_si256(high, low)
}

/// As [`fold`], both halves each for itself.
#[inline]
#[target_feature(enable = "avx2,vpclmulqdq")]
fn fold_pair(pair: __m256i, powers: __m128i, next: __m256i) -> __m256i {
    _mm256_xor_si256(bring_down_pair(pair, _mm256_broadcastsi128_si256(powers)), next)
}

/// The CRC of a head and at most [`DIRECT_BLOCKS`] blocks after it.
#[target_feature(enable = "avx2,vpclmulqdq,pclmulqdq,ssse3")]
pub(super) fn direct(head: __m128i, blocks: &[[u8; 16]]) -> u16 {
    let powers = POWERS.get(DIRECT_BLOCKS.wrapping_sub(blocks.len())..).unwrap_or_default();
    // Where the number is odd, the head and the first block make a pair.
    let (first, blocks, powers) = match (blocks.split_first(), powers) {
        (Some((block, blocks)), [of_head, of_block, powers @ ..]) if blocks.len() % 2 == 0 => {
            let pair = _mm256_set_m128i(polynomial_of(load_block(block), 16), head);
            (bring_down_pair(pair, both(&[*of_head, *of_block])), blocks, powers)
        }
        (_, [[low, high], powers @ ..]) => {
            let head = bring_down(head, _mm_set_epi64x(*high as i64, *low as i64));
            (_mm256_set_m128i(_mm_setzero_si128(), head), blocks, powers)
        }
        (_, []) => return 0,
    };
    let mut sum = first;
    for (pair, powers) in blocks.as_chunks::<2>().0.iter().zip(powers.as_chunks::<2>().0) {
        sum = _mm256_xor_si256(sum, bring_down_pair(load(pair), both(powers)));
    }
    let upper = _mm256_extracti128_si256::<1>(sum);
    reduce(_mm_xor_si128(_mm256_castsi256_si128(sum), upper))
}

/// The powers of two neighbouring blocks.
#[inline]
#[target_feature(enable = "avx2")]
fn both(&[first, second]: &[[u64; 2]; 2]) -> __m256i {
    let [low0, high0] = first.map(|power| power as i64);
    let [low1, high1] = second.map(|power| power as i64);
    _mm256_set_epi64x(high1, low1, high0, low0)
}

/// The CRC of a head and many blocks after it.
#[target_feature(enable = "avx2,vpclmulqdq,pclmulqdq,ssse3")]
pub(super) fn long(head: __m128i, blocks: &[[u8; 16]]) -> u16 {
    // The head stands one block above the first, where the last half was before it.
    let mut lanes = [_mm256_setzero_si256(); LANES];
    lanes[LANES - 1] = _mm256_set_m128i(head, _mm_setzero_si128());
    let (pairs, odd) = blocks.as_chunks::<2>();
    let (groups, rest) = pairs.as_chunks::<LANES>();
    for group in groups {
        for (lane, pair) in lanes.iter_mut().zip(group) {
            *lane = fold_pair(*lane, over::<{ 2 * LANES }>(), load(pair));
        }
    }
    let [first, second, third, fourth] = lanes;
    let mut pair = fold_pair(first, over::<2>(), second);
    pair = fold_pair(pair, over::<2>(), third);
    pair = fold_pair(pair, over::<2>(), fourth);
    for next in rest {
        pair = fold_pair(pair, over::<2>(), load(next));
    }
    let last = _mm256_extracti128_si256::<1>(pair);
    reduce(sum_of(fold(_mm256_castsi256_si128(pair), over::<1>(), last), odd))
}
