//! Folding of long inputs by two blocks at once (VPCLMULQDQ).

use core::arch::x86_64::{
    __m128i, __m256i, _mm_setzero_si128, _mm256_broadcastsi128_si256, _mm256_castsi256_si128,
    _mm256_clmulepi64_epi128, _mm256_extracti128_si256, _mm256_loadu_si256, _mm256_set_epi8,
    _mm256_set_m128i, _mm256_setzero_si256, _mm256_shuffle_epi8, _mm256_xor_si256,
};

use super::{fold, over, reduce, sum_of};

/// Pairs of remainders that run side by side.
const LANES: usize = 4;

/// Two blocks as polynomials, the first in the lower half.
#[inline]
#[target_feature(enable = "avx2")]
fn load(pair: &[[u8; 16]; 2]) -> __m256i {
    let reversed = _mm256_set_epi8(
        0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, //
        0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15,
    );
    // SAFETY: 32 bytes can be read behind the reference, and the load needs no alignment.
    let bytes = unsafe { _mm256_loadu_si256(pair.as_ptr().cast()) };
    _mm256_shuffle_epi8(bytes, reversed)
}

/// As [`fold`](super::fold), both halves each for itself.
#[inline]
#[target_feature(enable = "avx2,vpclmulqdq")]
fn fold_pair(pair: __m256i, powers: __m128i, next: __m256i) -> __m256i {
    let powers = _mm256_broadcastsi128_si256(powers);
    let high = _mm256_clmulepi64_epi128::<0x11>(pair, powers);
    let low = _mm256_clmulepi64_epi128::<0x00>(pair, powers);
    _mm256_xor_si256(_mm256_xor_si256(high, low), next)
}

/// The CRC of a head and the blocks behind it.
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
