//! The three CRCs of CAN, over complete bits.

/// One CRC of `WIDTH` bits, with its byte table.
pub(super) struct BitCrc {
    width: u32,
    polynomial: u32,
    initial: u32,
    table: [u32; 256],
}

impl BitCrc {
    const fn new(width: u32, polynomial: u32, initial: u32) -> Self {
        let mut table = [0; 256];
        let mut byte = 0;
        while byte < 256 {
            let mut register = (byte as u32) << (width - 8);
            let mut bit = 0;
            while bit < 8 {
                register = shift(register, width, polynomial);
                bit += 1;
            }
            table[byte] = register;
            byte += 1;
        }
        Self { width, polynomial, initial, table }
    }

    pub(super) const fn start(&self) -> u32 {
        self.initial
    }

    pub(super) const fn bit(&self, register: u32, bit: bool) -> u32 {
        let mixed = register ^ ((bit as u32) << (self.width - 1));
        shift(mixed, self.width, self.polynomial)
    }

    /// Adds eight bits, the most significant first.
    #[inline]
    pub(super) const fn byte(&self, register: u32, byte: u8) -> u32 {
        let index = ((register >> (self.width - 8)) as u8) ^ byte;
        ((register << 8) & mask(self.width)) ^ self.table[index as usize]
    }
}

const fn mask(width: u32) -> u32 {
    (1 << width) - 1
}

const fn shift(register: u32, width: u32, polynomial: u32) -> u32 {
    let out = register >> (width - 1) & 1;
    let moved = (register << 1) & mask(width);
    if out == 1 { moved ^ polynomial } else { moved }
}

/// CRC of classic frames: over the unstuffed bits from SOF to the data field.
pub(super) static CRC15: BitCrc = BitCrc::new(15, 0x4599, 0);
/// CRC of FD frames of up to 16 data bytes: over stuffed bits and the stuff count.
pub(super) static CRC17: BitCrc = BitCrc::new(17, 0x1685B, 1 << 16);
/// CRC of FD frames of more than 16 data bytes: over stuffed bits and the stuff count.
pub(super) static CRC21: BitCrc = BitCrc::new(21, 0x10_2899, 1 << 20);

#[cfg(test)]
mod tests {
    use super::*;

    /// The check values of the CRC catalogue refer to nine digits with start value zero.
    #[test]
    fn catalogue_check_values_match() {
        for (crc, check) in [(&CRC15, 0x059E), (&CRC17, 0x0_4F03), (&CRC21, 0x0E_D841)] {
            let bytewise = b"123456789".iter().fold(0, |r, &b| crc.byte(r, b));
            let bitwise = b"123456789"
                .iter()
                .flat_map(|&b| (0..8).rev().map(move |i| b >> i & 1 == 1))
                .fold(0, |r, bit| crc.bit(r, bit));
            assert_eq!(bytewise, check);
            assert_eq!(bitwise, check);
        }
    }

    #[test]
    fn fd_crcs_start_with_highest_bit_set() {
        assert_eq!(CRC15.start(), 0);
        assert_eq!(CRC17.start(), 0x1_0000);
        assert_eq!(CRC21.start(), 0x10_0000);
    }
}
