//! FMMUs: mapping of logical addresses to the memory of a slave, by bytes and by bits.

pub(super) const FMMU_BYTES: usize = 16;
pub(super) const FMMUS: usize = 8;

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Fmmu {
    pub(super) logical: u32,
    pub(super) length: u16,
    first_bit: u8,
    last_bit: u8,
    pub(super) physical: u16,
    physical_bit: u8,
    pub(super) reads: bool,
    pub(super) writes: bool,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Part {
    Bytes {
        /// First byte in the datagram's data.
        at: usize,
        length: usize,
        /// First byte in the memory.
        physical: u16,
    },
    /// Bits that begin or end inside bytes.
    Bits {
        /// First bit in the datagram's data.
        at: usize,
        length: usize,
        /// First bit in the memory, counted from the byte 0.
        physical: usize,
    },
}

impl Fmmu {
    /// Decodes registers; `None` while disabled or without a mapping.
    pub(super) fn from_registers(registers: &[u8; FMMU_BYTES]) -> Option<Self> {
        let [l0, l1, l2, l3, n0, n1, first, last, p0, p1, bit, direction, active, ..] = *registers;
        let length = u16::from_le_bytes([n0, n1]);
        (active & 1 == 1 && length > 0).then_some(Self {
            logical: u32::from_le_bytes([l0, l1, l2, l3]),
            length,
            first_bit: first & 7,
            last_bit: last & 7,
            physical: u16::from_le_bytes([p0, p1]),
            physical_bit: bit & 7,
            reads: direction & 1 == 1,
            writes: direction & 2 == 2,
        })
    }

    pub(super) fn part(&self, logical: u32, bytes: usize) -> Option<Part> {
        let own = i64::from(self.logical);
        let datagram = i64::from(logical);
        let first = own.max(datagram);
        let end = (own + i64::from(self.length)).min(datagram + bytes as i64);
        if first >= end {
            return None;
        }
        let (at, within) = ((first - datagram) as usize, (first - own) as usize);
        let length = (end - first) as usize;
        if (self.first_bit, self.last_bit, self.physical_bit) == (0, 7, 0) {
            let physical = self.physical.checked_add(u16::try_from(within).ok()?)?;
            return Some(Part::Bytes { at, length, physical });
        }
        // without the bits of the first and last byte outside the FMMU
        let is_first = within == 0;
        let is_last = end == own + i64::from(self.length);
        let from = at * 8 + if is_first { usize::from(self.first_bit) } else { 0 };
        let to = (at + length) * 8 - if is_last { 7 - usize::from(self.last_bit) } else { 0 };
        let before = if is_first { 0 } else { within * 8 - usize::from(self.first_bit) };
        let physical = usize::from(self.physical) * 8 + usize::from(self.physical_bit) + before;
        (from < to).then(|| Part::Bits { at: from, length: to - from, physical })
    }
}

/// Copies bits between byte strings, least significant bit first; bits outside are dropped.
pub(super) fn copy_bits(from: &[u8], first: usize, to: &mut [u8], at: usize, length: usize) {
    for bit in 0..length {
        let Some(source) = from.get((first + bit) / 8) else { return };
        let is_set = source >> ((first + bit) % 8) & 1 == 1;
        let Some(target) = to.get_mut((at + bit) / 8) else { return };
        let mask = 1 << ((at + bit) % 8);
        *target = if is_set { *target | mask } else { *target & !mask };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn fmmu(registers: [u8; FMMU_BYTES]) -> Fmmu {
        Fmmu::from_registers(&registers).unwrap()
    }

    #[test]
    fn byte_mapping_is_cut_to_the_datagram() {
        let bytes = fmmu([0, 0x10, 0, 0, 0x80, 1, 0, 7, 0x00, 0x11, 0, 2, 1, 0, 0, 0]);
        assert!(bytes.writes && !bytes.reads);
        let whole = Part::Bytes { at: 0, length: 0x180, physical: 0x1100 };
        assert_eq!(bytes.part(0x1000, 0x180), Some(whole));
        let first = Part::Bytes { at: 16, length: 84, physical: 0x1100 };
        assert_eq!(bytes.part(0x0FF0, 100), Some(first));
        let last = Part::Bytes { at: 0, length: 0x80, physical: 0x1200 };
        assert_eq!(bytes.part(0x1100, 1000), Some(last));
        assert_eq!(bytes.part(0x1180, 10), None);
        assert_eq!(bytes.part(0x0F00, 0x100), None);
        assert_eq!(Fmmu::from_registers(&[0; FMMU_BYTES]), None);
    }

    #[test]
    fn bits_keep_their_order_across_byte_borders() {
        // Logical 5.3 to 6.2 (eight bits) are physical 0x1000.6 to 0x1001.5.
        let bits = fmmu([5, 0, 0, 0, 2, 0, 3, 2, 0, 0x10, 6, 1, 1, 0, 0, 0]);
        let part = bits.part(4, 4).unwrap();
        assert_eq!(part, Part::Bits { at: 11, length: 8, physical: 0x8006 });
        // Only the second byte.
        assert_eq!(bits.part(6, 1), Some(Part::Bits { at: 0, length: 3, physical: 0x8006 + 5 }));
        let memory = [0b1100_0000, 0b0010_1010];
        let mut data = [0xFF; 4];
        copy_bits(&memory, 6, &mut data, 11, 8);
        assert_eq!(data, [0xFF, 0b0101_1111, 0b1111_1101, 0xFF]);
    }
}
