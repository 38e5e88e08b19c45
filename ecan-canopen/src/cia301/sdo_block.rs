//! Block transfer: segments of a block and the CRC over the value (CiA 301, 7.2.4.3.10).

/// Most segments of a block.
pub const MAX_BLOCK_SIZE: u8 = 127;

const END: u8 = 0x80;

/// A segment of a block: it has no command, only its number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BlockSegment {
    /// Number in the block, 1 to 127.
    pub sequence: u8,
    /// True if it is the last of the value.
    pub last: bool,
    /// Its bytes; in the last segment some may not count.
    pub data: [u8; 7],
}

impl BlockSegment {
    /// A segment of up to 7 bytes, filled up with zeros.
    pub fn new(sequence: u8, value: &[u8], last: bool) -> Self {
        let mut data = [0; 7];
        for (to, from) in data.iter_mut().zip(value) {
            *to = *from;
        }
        Self { sequence: sequence & !END, last, data }
    }

    /// The frame.
    pub fn to_bytes(self) -> [u8; 8] {
        let mut frame = [0; 8];
        frame[0] = self.sequence & !END | if self.last { END } else { 0 };
        frame[1..].copy_from_slice(&self.data);
        frame
    }

    /// Reads a frame that comes while a block is under way; `None` without a number from 1 to
    /// 127 or without 8 bytes. An abort (0x80) has the number 0.
    pub fn parse(data: &[u8]) -> Option<Self> {
        let &[head, a, b, c, d, e, f, g] = data else { return None };
        let sequence = head & !END;
        (sequence > 0).then_some(Self {
            sequence,
            last: head & END != 0,
            data: [a, b, c, d, e, f, g],
        })
    }
}

/// CRC of a value that block transfer carries: CRC-16 with polynomial 0x1021 and start value 0
/// (XMODEM). `crc` is that of what came before, 0 at first.
pub fn block_crc(crc: u16, value: &[u8]) -> u16 {
    value.iter().fold(crc, |crc, byte| {
        let nth = usize::from((crc >> 8) as u8 ^ byte);
        // infallible: a byte indexes a table of 256
        crc << 8 ^ TABLE[nth]
    })
}

static TABLE: [u16; 256] = table();

const fn table() -> [u16; 256] {
    let mut table = [0; 256];
    let mut byte = 0;
    while byte < 256 {
        let mut crc = (byte as u16) << 8;
        let mut bit = 0;
        while bit < 8 {
            crc = if crc & 0x8000 == 0 { crc << 1 } else { crc << 1 ^ 0x1021 };
            bit += 1;
        }
        table[byte] = crc;
        byte += 1;
    }
    table
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn crc_check_value() {
        assert_eq!(block_crc(0, b"123456789"), 0x31C3);
    }

    proptest! {
        #[test]
        fn crc_is_xmodem(
            value in proptest::collection::vec(any::<u8>(), 0..200),
            cut in any::<proptest::sample::Index>(),
        ) {
            let oracle = crc::Crc::<u16>::new(&crc::CRC_16_XMODEM).checksum(&value);
            let (front, back) = value.split_at(cut.index(value.len() + 1));
            prop_assert_eq!(block_crc(block_crc(0, front), back), oracle);
        }

        #[test]
        fn segments_come_back(sequence in 1..=127u8, last: bool, data: [u8; 7]) {
            let segment = BlockSegment::new(sequence, &data, last);
            prop_assert_eq!(BlockSegment::parse(&segment.to_bytes()), Some(segment));
        }
    }

    #[test]
    fn abort_is_not_a_segment() {
        assert_eq!(BlockSegment::parse(&[0x80, 0, 0, 0, 0, 0, 0, 0]), None);
        assert_eq!(BlockSegment::parse(&[1; 7]), None);
    }
}
