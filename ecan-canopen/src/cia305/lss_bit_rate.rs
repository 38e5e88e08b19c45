//! Bit rates of LSS (CiA 305, standard table of bit timings).

ecan_protocol::text_enum! {
    /// Entry of the table of bit timings 0, the table of CiA.
    #[derive(PartialOrd, Ord)]
    pub enum LssBitRate: u8;
    /// 1 Mbit/s.
    Rate1000k = 0, "1 Mbit/s";
    /// 800 kbit/s.
    Rate800k = 1, "800 kbit/s";
    /// 500 kbit/s.
    Rate500k = 2, "500 kbit/s";
    /// 250 kbit/s.
    Rate250k = 3, "250 kbit/s";
    /// 125 kbit/s.
    Rate125k = 4, "125 kbit/s";
    /// 50 kbit/s. The number 5 is reserved.
    Rate50k = 6, "50 kbit/s";
    /// 20 kbit/s.
    Rate20k = 7, "20 kbit/s";
    /// 10 kbit/s.
    Rate10k = 8, "10 kbit/s";
    /// Automatic bit rate detection.
    Automatic = 9, "automatic";
}

impl LssBitRate {
    /// Number of the table.
    pub const TABLE: u8 = 0;

    /// Bit rate in bit/s; `None` for automatic detection.
    pub const fn bit_per_s(self) -> Option<u32> {
        Some(match self {
            Self::Rate1000k => 1_000_000,
            Self::Rate800k => 800_000,
            Self::Rate500k => 500_000,
            Self::Rate250k => 250_000,
            Self::Rate125k => 125_000,
            Self::Rate50k => 50_000,
            Self::Rate20k => 20_000,
            Self::Rate10k => 10_000,
            Self::Automatic => return None,
        })
    }

    /// The entry with this bit rate in bit/s; `None` if the table does not have it.
    pub fn from_bit_per_s(bit_per_s: u32) -> Option<Self> {
        Self::ALL.iter().copied().find(|entry| entry.bit_per_s() == Some(bit_per_s))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn table_has_the_numbers_of_cia_305() {
        let numbers = [
            (1_000_000, 0),
            (800_000, 1),
            (500_000, 2),
            (250_000, 3),
            (125_000, 4),
            (50_000, 6),
            (20_000, 7),
            (10_000, 8),
        ];
        for (bit_per_s, number) in numbers {
            let entry = LssBitRate::from_bit_per_s(bit_per_s).unwrap();
            assert_eq!((entry.raw(), entry.bit_per_s()), (number, Some(bit_per_s)));
        }
        assert_eq!(LssBitRate::from_raw(5), None);
        assert_eq!(LssBitRate::from_bit_per_s(100_000), None);
        assert_eq!(LssBitRate::Automatic.bit_per_s(), None);
    }
}
