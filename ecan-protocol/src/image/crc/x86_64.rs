//! Carry-less multiplication of x86-64: PCLMULQDQ.

use core::arch::x86_64::{
    __cpuid_count, __m128i, _mm_clmulepi64_si128, _mm_cvtsi128_si32, _mm_loadu_si128, _mm_set_epi8,
    _mm_set_epi64x, _mm_set1_epi8, _mm_shuffle_epi8, _mm_slli_si128, _mm_sub_epi8, _mm_xor_si128,
    _xgetbv, CpuidResult,
};

use super::shared::{ABSENT, POLYNOMIAL, PRESENT, level, quotient};

/// 16 bytes, or a polynomial of degree 127 at most.
pub(super) type Block = __m128i;

/// AVX2 and VPCLMULQDQ besides.
const WIDE: u8 = PRESENT + 1;

/// The compiler may use the instructions anywhere.
pub(super) const IS_CERTAIN: bool =
    cfg!(all(target_feature = "pclmulqdq", target_feature = "ssse3"));

#[inline]
pub(super) fn is_wide() -> bool {
    level(detect) == WIDE
}

pub(super) fn detect() -> u8 {
    if cfg!(miri) {
        // Miri has no cpuid.
        return if IS_CERTAIN { PRESENT } else { ABSENT };
    }
    Support::read().level()
}

/// What processor and system state about the instructions.
#[derive(Clone, Copy)]
struct Support {
    /// ECX of leaf 1.
    features: u32,
    /// EBX and ECX of leaf 7; 0 if there is none.
    extended: (u32, u32),
    /// Registers that the system keeps; 0 if it does not say.
    kept: u64,
}

impl Support {
    const PCLMULQDQ: u32 = 1 << 1;
    const SSSE3: u32 = 1 << 9;
    const OSXSAVE: u32 = 1 << 27;
    const AVX: u32 = 1 << 28;
    const AVX2: u32 = 1 << 5;
    const VPCLMULQDQ: u32 = 1 << 10;
    const SSE_AND_AVX_STATE: u64 = 0b110;

    fn read() -> Self {
        const EXTENDED_FEATURES: u32 = 7;
        let features = cpuid(1).ecx;
        let extended = match cpuid(0).eax {
            0..EXTENDED_FEATURES => (0, 0),
            _ => (cpuid(EXTENDED_FEATURES).ebx, cpuid(EXTENDED_FEATURES).ecx),
        };
        let kept = match features & Self::OSXSAVE {
            0 => 0,
            // SAFETY: OSXSAVE says that the instruction may be used.
            _ => unsafe { _xgetbv(0) },
        };
        Self { features, extended, kept }
    }

    fn level(self) -> u8 {
        let Self { features, extended: (ebx, ecx), kept } = self;
        let has = |bits: u32| features & bits == bits;
        let is_wide = has(Self::OSXSAVE | Self::AVX)
            && kept & Self::SSE_AND_AVX_STATE == Self::SSE_AND_AVX_STATE
            && ebx & Self::AVX2 != 0
            && ecx & Self::VPCLMULQDQ != 0;
        match has(Self::PCLMULQDQ | Self::SSSE3) {
            true if is_wide => WIDE,
            true => PRESENT,
            false => ABSENT,
        }
    }
}

#[allow(unused_unsafe, reason = "newer versions of Rust have a safe function")]
fn cpuid(leaf: u32) -> CpuidResult {
    // SAFETY: every processor of this architecture has the instruction.
    unsafe { __cpuid_count(leaf, 0) }
}

/// The bytes as they lie in memory.
#[inline]
#[target_feature(enable = "pclmulqdq,ssse3")]
pub(super) fn load(bytes: &[u8; 16]) -> Block {
    // SAFETY: 16 bytes can be read after the reference, and the load needs no alignment.
    unsafe { _mm_loadu_si128(bytes.as_ptr().cast()) }
}

/// A polynomial from its halves.
#[inline]
#[target_feature(enable = "pclmulqdq,ssse3")]
pub(super) fn from_halves(low: u64, high: u64) -> Block {
    _mm_set_epi64x(high as i64, low as i64)
}

#[inline]
#[target_feature(enable = "pclmulqdq,ssse3")]
pub(super) fn add(left: Block, right: Block) -> Block {
    _mm_xor_si128(left, right)
}

/// The first `count` (1 to 16) of 16 bytes as a polynomial, the first byte highest.
#[inline]
#[target_feature(enable = "pclmulqdq,ssse3")]
pub(super) fn polynomial_of(bytes: Block, count: usize) -> Block {
    let places = _mm_set_epi8(15, 14, 13, 12, 11, 10, 9, 8, 7, 6, 5, 4, 3, 2, 1, 0);
    // Where nothing is left to take, the index is negative, which yields zero.
    let indices = _mm_sub_epi8(_mm_set1_epi8(count as i8 - 1), places);
    _mm_shuffle_epi8(bytes, indices)
}

/// High half by high power plus low half by low power.
#[inline]
#[target_feature(enable = "pclmulqdq,ssse3")]
pub(super) fn bring_down(value: Block, powers: Block) -> Block {
    let high = _mm_clmulepi64_si128::<0x11>(value, powers);
    let low = _mm_clmulepi64_si128::<0x00>(value, powers);
    _mm_xor_si128(high, low)
}

/// A polynomial of at most 80 bits mod P.
#[inline]
#[target_feature(enable = "pclmulqdq,ssse3")]
pub(super) fn reduce(sum: Block) -> u16 {
    // Barrett: the quotient by P from the upper 64 bits and the quotient of x^80, whose highest
    // term is the upper bits themselves.
    let constants = const { [quotient() as i64, POLYNOMIAL as i64] };
    let constants = _mm_set_epi64x(constants[1], constants[0]);
    let upper = _mm_slli_si128::<6>(sum);
    let times = _mm_xor_si128(upper, _mm_clmulepi64_si128::<0x01>(upper, constants));
    let product = _mm_clmulepi64_si128::<0x11>(times, constants);
    _mm_cvtsi128_si32(_mm_xor_si128(sum, product)) as u16
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_missing_feature_lowers_the_level() {
        let narrow = Support::PCLMULQDQ | Support::SSSE3;
        let features = narrow | Support::OSXSAVE | Support::AVX;
        let extended = (Support::AVX2, Support::VPCLMULQDQ);
        let all = Support { features, extended, kept: 0b111 };
        assert_eq!(all.level(), WIDE);
        for missing in [
            Support { features: features & !Support::OSXSAVE, ..all },
            Support { features: features & !Support::AVX, ..all },
            Support { extended: (!Support::AVX2, Support::VPCLMULQDQ), ..all },
            Support { extended: (Support::AVX2, !Support::VPCLMULQDQ), ..all },
            Support { kept: 0b101, ..all },
            Support { kept: 0b011, ..all },
        ] {
            assert_eq!(missing.level(), PRESENT);
        }
        for bit in [Support::PCLMULQDQ, Support::SSSE3] {
            assert_eq!(Support { features: features & !bit, ..all }.level(), ABSENT);
        }
        assert_eq!(Support { features: narrow, extended: (0, 0), kept: 0 }.level(), PRESENT);
    }
}
