//! CRC-16/CCITT-FALSE of the frame area (manual 5.4.4.1, 11).

#[cfg(all(target_arch = "aarch64", target_feature = "neon"))]
mod aarch64;
#[cfg(any(
    all(target_arch = "x86_64", target_feature = "sse2"),
    all(target_arch = "aarch64", target_feature = "neon")
))]
mod folding;
#[cfg_attr(
    not(any(
        all(target_arch = "x86_64", target_feature = "sse2"),
        all(target_arch = "aarch64", target_feature = "neon")
    )),
    allow(dead_code)
)]
mod shared;
#[cfg(all(target_arch = "x86_64", target_feature = "sse2"))]
mod wide;
#[cfg(all(target_arch = "x86_64", target_feature = "sse2"))]
mod x86_64;

use shared::POLYNOMIAL;

const INITIAL: u16 = 0xFFFF;

/// `TABLES[k][b]` is the CRC, from 0, of the byte `b` followed by `k` zero bytes.
static TABLES: [[u16; 256]; 16] = tables();

const fn tables() -> [[u16; 256]; 16] {
    let mut tables = [[0; 256]; 16];
    let mut byte = 0;
    while byte < 256 {
        let mut crc = (byte as u16) << 8;
        let mut bit = 0;
        while bit < 8 {
            crc = if crc & 0x8000 != 0 { crc << 1 ^ POLYNOMIAL } else { crc << 1 };
            bit += 1;
        }
        tables[0][byte] = crc;
        byte += 1;
    }
    let mut zeros = 1;
    while zeros < 16 {
        let mut byte = 0;
        while byte < 256 {
            let crc = tables[zeros - 1][byte];
            tables[zeros][byte] = crc << 8 ^ tables[0][(crc >> 8) as usize];
            byte += 1;
        }
        zeros += 1;
    }
    tables
}

#[inline(always)]
fn entry(zeros: usize, byte: u8) -> u16 {
    // infallible: callers pass 0 to 15, and a byte indexes 256 entries
    TABLES[zeros & 15][usize::from(byte)]
}

/// CRC-16/CCITT-FALSE: polynomial 0x1021, start 0xFFFF, nothing reflected, no final XOR.
///
/// Uses the fastest kernel of the processor; never allocates or blocks, real-time safe.
#[inline]
pub fn crc16(data: &[u8]) -> u16 {
    accelerated::crc16(data).unwrap_or_else(|| crc16_portable(data))
}

/// CRC-16/CCITT-FALSE by table look-up only, 16 bytes per step. For processors without carry-less
/// multiplication and for comparison.
pub fn crc16_portable(data: &[u8]) -> u16 {
    let (blocks, tail) = data.as_chunks::<16>();
    let mut crc = INITIAL;
    for block in blocks {
        crc = step(crc, block);
    }
    step(crc, tail)
}

/// Continues the CRC `crc` with up to 16 bytes.
#[inline(always)]
fn step(crc: u16, bytes: &[u8]) -> u16 {
    let [high, low] = crc.to_be_bytes();
    match *bytes {
        [] => crc,
        [first] => crc << 8 ^ entry(0, first ^ high),
        [first, second, ref rest @ ..] => {
            // Bytes that do not depend on `crc` come first, so that few look-ups wait for it.
            let mut sum = 0;
            for (zeros, &byte) in rest.iter().rev().enumerate() {
                sum ^= entry(zeros, byte);
            }
            let zeros = rest.len();
            sum ^ (entry(zeros + 1, first ^ high) ^ entry(zeros, second ^ low))
        }
    }
}

/// True if [`crc16`] uses carry-less multiplication on this processor.
pub fn crc16_is_accelerated() -> bool {
    accelerated::is_available()
}

/// Makes [`crc16`] do without carry-less multiplication from now on, or take it up again where the
/// processor has it. For benchmarks and tests of the codec without it; it has no effect where the
/// program was compiled for processors that always have it.
#[doc(hidden)]
pub fn crc16_use_portable(on: bool) {
    accelerated::pretend_absent(on);
}

/// The kernels of processors with carry-less multiplication.
#[cfg(any(
    all(target_arch = "x86_64", target_feature = "sse2"),
    all(target_arch = "aarch64", target_feature = "neon")
))]
mod accelerated {
    #[cfg(target_arch = "aarch64")]
    use super::aarch64 as processor;
    use super::folding::{DIRECT_BLOCKS, fold, long, over, short, sum_of};
    use super::shared::{PRESENT, level};
    #[cfg(target_arch = "x86_64")]
    use super::{wide, x86_64 as processor};
    use processor::{add, from_halves, load, polynomial_of, reduce};

    pub(super) use super::shared::pretend_absent;

    /// Shortest input, that of the smallest packet.
    const MIN_BYTES: usize = 4;

    /// From this many blocks after the first on it pays to take two at once.
    #[cfg(target_arch = "x86_64")]
    const WIDE_BLOCKS: usize = 3;

    #[inline]
    pub(super) fn is_available() -> bool {
        processor::IS_CERTAIN || level(processor::detect) >= PRESENT
    }

    /// CRC-16/CCITT-FALSE of `data`, unless it is too short or the processor has no instructions for it.
    #[inline]
    pub(super) fn crc16(data: &[u8]) -> Option<u16> {
        // SAFETY: the processor has the instructions, as just checked.
        (data.len() >= MIN_BYTES && is_available()).then(|| unsafe { folded(data) })
    }

    /// The CRC of [`MIN_BYTES`] and more.
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
        if blocks.len() <= DIRECT_BLOCKS {
            reduce(sum_of(head, blocks))
        } else {
            long(head, blocks)
        }
    }
}

/// Of other processors no kernel is accelerated.
#[cfg(not(any(
    all(target_arch = "x86_64", target_feature = "sse2"),
    all(target_arch = "aarch64", target_feature = "neon")
)))]
mod accelerated {
    pub(super) fn crc16(_: &[u8]) -> Option<u16> {
        None
    }

    pub(super) fn is_available() -> bool {
        false
    }

    pub(super) fn pretend_absent(_: bool) {}
}

#[cfg(test)]
mod tests {
    extern crate std;

    use std::vec::Vec;

    use super::*;

    #[test]
    fn crc_check_value() {
        assert_eq!(crc16(b"123456789"), 0x29B1);
        assert_eq!(crc16_portable(b"123456789"), 0x29B1);
        assert_eq!(crc16(b""), 0xFFFF);
    }

    /// A processor would otherwise use its best level only.
    #[cfg(any(
        all(target_arch = "x86_64", target_feature = "sse2"),
        all(target_arch = "aarch64", target_feature = "neon")
    ))]
    #[test]
    fn every_level_gives_the_same() {
        #[cfg(target_arch = "aarch64")]
        use aarch64 as processor;
        use shared::with_each_level;
        #[cfg(target_arch = "x86_64")]
        use x86_64 as processor;

        let data: Vec<u8> = (0..1000_u32).map(|i| ((i * i) >> 3) as u8).collect();
        let is_available = processor::IS_CERTAIN || processor::detect() >= shared::PRESENT;
        // Miri takes seconds for each length.
        let step = if cfg!(miri) { 61 } else { 1 };
        let tested = with_each_level(processor::detect(), |level| {
            for length in (0..data.len()).step_by(step) {
                let data = &data[..length];
                assert_eq!(crc16(data), crc16_portable(data), "level {level}, {length} bytes");
            }
        });
        assert!(tested > usize::from(is_available), "{tested} levels");
        assert_eq!(accelerated::is_available(), is_available);
        crc16_use_portable(true);
        assert_eq!(crc16_is_accelerated(), processor::IS_CERTAIN);
        crc16_use_portable(false);
        assert_eq!(crc16_is_accelerated(), is_available);
    }

    /// The standard library says what the processor has.
    #[cfg(all(target_arch = "x86_64", target_feature = "sse2", not(miri)))]
    #[test]
    fn best_level_of_the_processor_is_used() {
        use std::is_x86_feature_detected as has;
        let is_present = has!("pclmulqdq") && has!("ssse3");
        let is_wide = is_present && has!("avx2") && has!("vpclmulqdq");
        assert_eq!(x86_64::detect(), 1 + u8::from(is_present) + u8::from(is_wide));
    }
}
