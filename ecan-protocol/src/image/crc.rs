//! CRC-16/CCITT-FALSE of the frame area (manual 5.4.4.1, 11).

#[cfg(any(
    all(target_arch = "x86_64", target_feature = "sse2"),
    all(target_arch = "aarch64", target_feature = "neon")
))]
mod folding;

/// Of other processors no kernel is accelerated.
#[cfg(not(any(
    all(target_arch = "x86_64", target_feature = "sse2"),
    all(target_arch = "aarch64", target_feature = "neon")
)))]
mod folding {
    pub(super) fn crc16(_: &[u8]) -> Option<u16> {
        None
    }

    pub(super) fn is_available() -> bool {
        false
    }

    pub(super) fn pretend_absent(_: bool) {}
}

/// x^16 + x^12 + x^5 + 1 without its highest term.
const POLYNOMIAL: u16 = 0x1021;
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
    folding::crc16(data).unwrap_or_else(|| crc16_portable(data))
}

/// The same CRC by table look-up only, 16 bytes per step. For processors without carry-less
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
    folding::is_available()
}

/// Makes [`crc16`] do without carry-less multiplication from now on, or take it up again where the
/// processor has it. For benchmarks and tests of the codec without it; it has no effect where the
/// program was compiled for processors that always have it.
#[doc(hidden)]
pub fn crc16_use_portable(on: bool) {
    folding::pretend_absent(on);
}

#[cfg(test)]
mod tests {
    use super::{crc16, crc16_portable};

    #[test]
    fn crc_check_value() {
        assert_eq!(crc16(b"123456789"), 0x29B1);
        assert_eq!(crc16_portable(b"123456789"), 0x29B1);
        assert_eq!(crc16(b""), 0xFFFF);
    }
}
