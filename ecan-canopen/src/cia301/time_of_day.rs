//! TIME (CiA 301, 7.2.6): the data type TIME_OF_DAY (7.1.6.5).

use core::fmt;

/// Days from 1970-01-01 to 1984-01-01.
const EPOCH_DAYS: u64 = 5_113;
const DAY_MS: u64 = 86_400_000;
const MS: u64 = 1_000_000;
/// Milliseconds have 28 bits; the upper four are reserved.
const MS_MASK: u32 = 0x0FFF_FFFF;

/// Time of day and date, in milliseconds and days since 1984-01-01.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct TimeOfDay {
    days: u16,
    ms: u32,
}

impl TimeOfDay {
    /// Milliseconds of a day.
    pub const DAY_MS: u32 = DAY_MS as u32;

    /// The time `ms` milliseconds after midnight, `days` days after 1984-01-01; `None` if `ms` is not below
    /// [`DAY_MS`](Self::DAY_MS).
    pub const fn new(days: u16, ms: u32) -> Option<Self> {
        if ms < Self::DAY_MS { Some(Self { days, ms }) } else { None }
    }

    /// Days since 1984-01-01.
    pub const fn days(self) -> u16 {
        self.days
    }

    /// Milliseconds after midnight.
    pub const fn ms(self) -> u32 {
        self.ms
    }

    /// Converts Unix time in nanoseconds; `None` before 1984 and after 2163-06-06, the last day that 16 bits express.
    pub fn from_unix_ns(unix_ns: u64) -> Option<Self> {
        let ms = unix_ns / MS;
        let days = u16::try_from((ms / DAY_MS).checked_sub(EPOCH_DAYS)?).ok()?;
        Some(Self { days, ms: (ms % DAY_MS) as u32 })
    }

    /// Unix time in nanoseconds.
    pub const fn unix_ns(self) -> u64 {
        ((self.days as u64 + EPOCH_DAYS) * DAY_MS + self.ms as u64) * MS
    }

    /// The data of the CAN frame.
    pub const fn to_bytes(self) -> [u8; 6] {
        let [a, b, c, d] = self.ms.to_le_bytes();
        let [low, high] = self.days.to_le_bytes();
        [a, b, c, d, low, high]
    }

    /// Reads the data of a CAN frame; `None` for another length, or for milliseconds beyond a day. Reserved bits
    /// are ignored.
    pub fn parse(data: &[u8]) -> Option<Self> {
        let &[a, b, c, d, low, high] = data else { return None };
        let ms = u32::from_le_bytes([a, b, c, d]) & MS_MASK;
        Self::new(u16::from_le_bytes([low, high]), ms)
    }
}

/// `day 15667, 13:45:00.250`
impl fmt::Display for TimeOfDay {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (seconds, ms) = (self.ms / 1_000, self.ms % 1_000);
        let (hours, minutes, seconds) = (seconds / 3_600, seconds / 60 % 60, seconds % 60);
        write!(f, "day {}, {hours:02}:{minutes:02}:{seconds:02}.{ms:03}", self.days)
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use std::string::ToString;

    use super::*;
    use proptest::prelude::*;

    const S: u64 = 1_000_000_000;

    #[test]
    fn epoch_is_1984() {
        // 1984-01-01T00:00:00Z
        let epoch = TimeOfDay::from_unix_ns(441_763_200 * S).unwrap();
        assert_eq!((epoch.days(), epoch.ms()), (0, 0));
        assert_eq!(TimeOfDay::from_unix_ns(441_763_200 * S - 1), None);
        // 2026-11-24T13:45:00.25Z
        let time = TimeOfDay::from_unix_ns(1_795_527_900 * S + 250_000_000).unwrap();
        assert_eq!((time.days(), time.ms()), (15_668, 49_500_250));
        assert_eq!(time.to_string(), "day 15668, 13:45:00.250");
        assert_eq!(time.to_bytes(), [0x5A, 0x50, 0xF3, 0x02, 0x34, 0x3D]);
        let last = TimeOfDay::new(u16::MAX, TimeOfDay::DAY_MS - 1).unwrap();
        assert_eq!(TimeOfDay::from_unix_ns(last.unix_ns()), Some(last));
        assert_eq!(TimeOfDay::from_unix_ns(last.unix_ns() + MS), None);
    }

    #[test]
    fn reserved_bits_are_ignored_and_wrong_data_rejected() {
        let time = TimeOfDay::new(2, 1).unwrap();
        assert_eq!(TimeOfDay::parse(&[1, 0, 0, 0xF0, 2, 0]), Some(time));
        assert_eq!(TimeOfDay::parse(&[0, 0x5C, 0x26, 0x05, 2, 0]), None, "24:00:00.000");
        assert_eq!(TimeOfDay::parse(&[0; 5]), None);
        assert_eq!(TimeOfDay::parse(&[0; 8]), None);
    }

    proptest! {
        #[test]
        fn times_survive_both_conversions(days: u16, ms in 0..TimeOfDay::DAY_MS) {
            let time = TimeOfDay::new(days, ms).unwrap();
            prop_assert_eq!(TimeOfDay::parse(&time.to_bytes()), Some(time));
            prop_assert_eq!(TimeOfDay::from_unix_ns(time.unix_ns()), Some(time));
        }
    }
}
