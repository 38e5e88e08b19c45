//! Position of a signal in the data of a frame.

/// Order of the bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ByteOrder {
    /// Intel: the start bit is the least significant one.
    LittleEndian,
    /// Motorola: the start bit is the most significant one.
    BigEndian,
}

/// Bits of a signal. Bit 0 is the least significant bit of byte 0, bit 8 that of byte 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BitLayout {
    start: u32,
    length: u32,
    order: ByteOrder,
}

impl BitLayout {
    /// Longest signal in bits.
    pub const MAX_LENGTH: u32 = 64;

    /// Layout of 1 to 64 bits that lie within a message of `bytes` bytes.
    pub fn new(start: u64, length: u64, order: ByteOrder, bytes: usize) -> Option<Self> {
        let (start, length) = (u32::try_from(start).ok()?, u32::try_from(length).ok()?);
        let layout = Self { start, length, order };
        let is_valid = (1..=Self::MAX_LENGTH).contains(&length) && layout.bytes()? <= bytes;
        is_valid.then_some(layout)
    }

    /// Number of data bytes that the signal needs.
    fn bytes(self) -> Option<usize> {
        let last = match self.order {
            ByteOrder::LittleEndian => self.start.checked_add(self.length - 1)?,
            ByteOrder::BigEndian => self.linear_start().checked_add(self.length - 1)?,
        };
        Some(last as usize / 8 + 1)
    }

    pub const fn length(self) -> u32 {
        self.length
    }

    /// Index of the most significant bit, counted from the most significant bit of byte 0.
    const fn linear_start(self) -> u32 {
        self.start / 8 * 8 + (7 - self.start % 8)
    }

    /// Byte and bit of each bit of the signal, least significant first.
    fn bits(self) -> impl Iterator<Item = (usize, u32)> {
        (0..self.length).map(move |at| match self.order {
            ByteOrder::LittleEndian => ((self.start + at) as usize / 8, (self.start + at) % 8),
            ByteOrder::BigEndian => {
                let linear = self.linear_start() + self.length - 1 - at;
                (linear as usize / 8, 7 - linear % 8)
            }
        })
    }

    /// Returns the bits, or `None` if the data are too short.
    pub fn extract(self, data: &[u8]) -> Option<u64> {
        let mut raw = 0;
        for (at, (byte, bit)) in (0..).zip(self.bits()) {
            raw |= u64::from(data.get(byte)? >> bit & 1) << at;
        }
        Some(raw)
    }

    /// Writes the bits. Data that are too short lose bits.
    pub fn insert(self, data: &mut [u8], raw: u64) {
        for (at, (byte, bit)) in (0..).zip(self.bits()) {
            if let Some(byte) = data.get_mut(byte) {
                *byte = *byte & !(1 << bit) | u8::from(raw >> at & 1 == 1) << bit;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn layouts_match_the_examples_of_the_format() {
        let little = BitLayout::new(4, 12, ByteOrder::LittleEndian, 2).unwrap();
        assert_eq!(little.extract(&[0xA0, 0xBC]), Some(0xBCA));
        // From bit 3 of byte 0 down, then from bit 7 of byte 1.
        let big = BitLayout::new(3, 12, ByteOrder::BigEndian, 2).unwrap();
        assert_eq!(big.extract(&[0xFA, 0xBC]), Some(0xABC));
        assert_eq!(big.extract(&[0xFA]), None);
        let mut data = [0xFF, 0];
        big.insert(&mut data, 0x123);
        assert_eq!(data, [0xF1, 0x23]);
    }

    #[test]
    fn layout_outside_the_message_is_rejected() {
        use ByteOrder::{BigEndian, LittleEndian};
        assert!(BitLayout::new(0, 64, LittleEndian, 8).is_some());
        assert!(BitLayout::new(7, 64, BigEndian, 8).is_some());
        assert!(BitLayout::new(1, 64, LittleEndian, 8).is_none());
        assert!(BitLayout::new(6, 64, BigEndian, 8).is_none());
        assert!(BitLayout::new(0, 0, LittleEndian, 8).is_none());
        assert!(BitLayout::new(0, 65, LittleEndian, 64).is_none());
        assert!(BitLayout::new(u64::MAX, 1, BigEndian, 8).is_none());
        assert!(BitLayout::new(u32::MAX.into(), 8, LittleEndian, 8).is_none());
        assert!(BitLayout::new(u32::MAX.into(), 64, BigEndian, 8).is_none());
    }

    proptest! {
        #[test]
        fn inserted_bits_are_extracted_and_others_stay(
            start in 0..512_u64,
            length in 1..=64_u64,
            is_big: bool,
            raw: u64,
            fill: u8,
        ) {
            let order = if is_big { ByteOrder::BigEndian } else { ByteOrder::LittleEndian };
            let Some(layout) = BitLayout::new(start, length, order, 64) else { return Ok(()) };
            let mut data = [fill; 64];
            layout.insert(&mut data, raw);
            let mask = u64::MAX >> (64 - length);
            prop_assert_eq!(layout.extract(&data), Some(raw & mask));
            let before = layout.extract(&[fill; 64]).unwrap();
            layout.insert(&mut data, before);
            prop_assert_eq!(data, [fill; 64]);
        }
    }
}
