//! Carry-less multiplication of 64-bit ARM: PMULL.

use core::arch::aarch64::{
    uint8x16_t, vcombine_u64, vcreate_u64, vdupq_n_u8, veorq_u8, vextq_u8, vgetq_lane_u64,
    vld1q_u8, vmull_high_p64, vmull_p64, vqtbl1q_u8, vreinterpretq_p64_u8, vreinterpretq_u8_p128,
    vreinterpretq_u8_u64, vreinterpretq_u64_u8, vsubq_u8,
};

use super::shared::{ABSENT, POLYNOMIAL, PRESENT, quotient};

/// 16 bytes, or a polynomial of degree 127 at most, its lowest byte first.
pub(super) type Block = uint8x16_t;

/// The compiler may use the instructions anywhere.
pub(super) const IS_CERTAIN: bool = cfg!(target_feature = "aes");

pub(super) fn detect() -> u8 {
    if IS_CERTAIN || has_pmull() { PRESENT } else { ABSENT }
}

/// True if the processor has PMULL, and AES, which is the same feature to the compiler.
#[cfg(target_os = "linux")]
fn has_pmull() -> bool {
    const NEEDED: libc::c_ulong = libc::HWCAP_PMULL | libc::HWCAP_AES;
    // SAFETY: the function reads a value that the kernel passes to every process.
    let features = unsafe { libc::getauxval(libc::AT_HWCAP) };
    features & NEEDED == NEEDED
}

/// Without Linux only the compiler's settings show what the processor has.
#[cfg(not(target_os = "linux"))]
fn has_pmull() -> bool {
    false
}

/// The bytes as they lie in memory.
#[inline]
#[target_feature(enable = "neon,aes")]
pub(super) fn load(bytes: &[u8; 16]) -> Block {
    // SAFETY: 16 bytes can be read after the reference, and the load needs no alignment.
    unsafe { vld1q_u8(bytes.as_ptr()) }
}

/// A polynomial from its halves.
#[inline]
#[target_feature(enable = "neon,aes")]
pub(super) fn from_halves(low: u64, high: u64) -> Block {
    vreinterpretq_u8_u64(vcombine_u64(vcreate_u64(low), vcreate_u64(high)))
}

#[inline]
#[target_feature(enable = "neon,aes")]
pub(super) fn add(left: Block, right: Block) -> Block {
    veorq_u8(left, right)
}

/// The first `count` (1 to 16) of 16 bytes as a polynomial, the first byte highest.
#[inline]
#[target_feature(enable = "neon,aes")]
pub(super) fn polynomial_of(bytes: Block, count: usize) -> Block {
    let places = from_halves(0x0706_0504_0302_0100, 0x0F0E_0D0C_0B0A_0908);
    // An index above 15, as below 0 after the subtraction, yields zero.
    let indices = vsubq_u8(vdupq_n_u8(count as u8 - 1), places);
    vqtbl1q_u8(bytes, indices)
}

/// High half by high power plus low half by low power.
#[inline]
#[target_feature(enable = "neon,aes")]
pub(super) fn bring_down(value: Block, powers: Block) -> Block {
    add(multiply_high(value, powers), multiply_low(value, powers))
}

#[inline]
#[target_feature(enable = "neon,aes")]
fn multiply_high(left: Block, right: Block) -> Block {
    let product = vmull_high_p64(vreinterpretq_p64_u8(left), vreinterpretq_p64_u8(right));
    vreinterpretq_u8_p128(product)
}

#[inline]
#[target_feature(enable = "neon,aes")]
fn multiply_low(left: Block, right: Block) -> Block {
    let low = |block| vgetq_lane_u64::<0>(vreinterpretq_u64_u8(block));
    vreinterpretq_u8_p128(vmull_p64(low(left), low(right)))
}

/// A polynomial of at most 80 bits mod P.
#[inline]
#[target_feature(enable = "neon,aes")]
pub(super) fn reduce(sum: Block) -> u16 {
    // Barrett: the quotient by P from the upper 64 bits and the quotient of x^80, whose highest
    // term is the upper bits themselves.
    let quotient = from_halves(0, const { quotient() });
    let divisor = from_halves(0, POLYNOMIAL.into());
    let upper = vextq_u8::<10>(from_halves(0, 0), sum);
    let times = add(upper, multiply_high(upper, quotient));
    let product = multiply_high(times, divisor);
    vgetq_lane_u64::<0>(vreinterpretq_u64_u8(add(sum, product))) as u16
}
