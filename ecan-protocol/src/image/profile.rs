//! PDO profiles: size, channels, encapsulation, budget and options of one direction
//! (manual 5.2, 9, 12, 13.2).

use core::fmt;

use crate::mapping::{CHUNK_BYTES, Direction, HEADER_BYTES, MAX_MULTIPLIER};

/// Channels that the current product has, as a mask.
const EXISTING_CHANNELS: u8 = 0x0F;

/// How frames are packed (manual 9).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[repr(u8)]
pub enum EncapsulationProfile {
    /// Profile 0: data length by DLC, no timestamp. The device default.
    #[default]
    Compact = 0,
    /// Profile 1: data length by DLC, timestamps allowed.
    CompactTimestamped = 1,
    /// Profile 4: 64 byte data windows allowed, no timestamp.
    Window64 = 4,
    /// Profile 5: 64 byte data windows and timestamps allowed.
    Window64Timestamped = 5,
}

impl EncapsulationProfile {
    /// All profiles that the manual defines.
    pub const ALL: [Self; 4] =
        [Self::Compact, Self::CompactTimestamped, Self::Window64, Self::Window64Timestamped];

    /// The profile with this number; `None` where the manual has none.
    #[must_use]
    pub const fn from_raw(raw: u8) -> Option<Self> {
        Some(match raw {
            0 => Self::Compact,
            1 => Self::CompactTimestamped,
            4 => Self::Window64,
            5 => Self::Window64Timestamped,
            _ => return None,
        })
    }

    /// The profile's number: 0, 1, 4 or 5.
    #[must_use]
    pub const fn raw(self) -> u8 {
        self as u8
    }

    /// Whether CAN FD data may take a fixed window of 64 bytes.
    #[must_use]
    pub const fn allows_d64(self) -> bool {
        matches!(self, Self::Window64 | Self::Window64Timestamped)
    }

    /// Whether received frames may carry timestamps.
    #[must_use]
    pub const fn allows_delta16(self) -> bool {
        matches!(self, Self::CompactTimestamped | Self::Window64Timestamped)
    }
}

/// How channels share the frame area (manual 12).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[repr(u8)]
pub enum BudgetPolicy {
    /// A small reserve for each channel, the rest shared. The device default.
    #[default]
    Balanced = 0,
    /// No reserve, everything shared.
    SharedOnly = 1,
    /// Equal parts for each enabled channel, none borrowed.
    Deterministic = 2,
}

impl BudgetPolicy {
    /// The policy with this number; `None` above 2.
    #[must_use]
    pub const fn from_raw(raw: u8) -> Option<Self> {
        Some(match raw {
            0 => Self::Balanced,
            1 => Self::SharedOnly,
            2 => Self::Deterministic,
            _ => return None,
        })
    }

    /// The policy's number.
    #[must_use]
    pub const fn raw(self) -> u8 {
        self as u8
    }
}

/// Options of a direction, 0x8010:07 and 0x8011:07 (manual 9.1).
#[derive(Clone, Copy, Default, PartialEq, Eq, Hash)]
pub struct OptionFlags(u8);

impl OptionFlags {
    /// No option, the device default.
    pub const NONE: Self = Self(0);
    /// The gateway reports the fate of each frame sent. Means nothing in RxPDO.
    pub const TX_RESULT: Self = Self(0x01);
    /// Packets are padded to 4 bytes.
    pub const ALIGN4: Self = Self(0x02);
    /// The header carries no CRC. For performance isolation tests.
    pub const NO_CRC16: Self = Self(0x04);
    /// The CAN side is cut off. For tests.
    pub const APP_BYPASS: Self = Self(0x08);
    /// Bytes behind the payload are left as they were.
    pub const PAYLOAD_ONLY: Self = Self(0x10);
    /// All options that the manual defines.
    pub const ALL: Self = Self(0x1F);

    /// Flags from their bits; `None` where a reserved bit (5 to 7) is set.
    #[must_use]
    pub const fn from_bits(bits: u8) -> Option<Self> {
        if bits & !Self::ALL.0 == 0 { Some(Self(bits)) } else { None }
    }

    /// The bits.
    #[must_use]
    pub const fn bits(self) -> u8 {
        self.0
    }

    /// Whether all flags of `other` are set.
    #[must_use]
    pub const fn contains(self, other: Self) -> bool {
        self.0 & other.0 == other.0
    }

    /// These flags and those of `other`.
    #[must_use]
    pub const fn with(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }

    /// These flags but for those of `other`.
    #[must_use]
    pub const fn without(self, other: Self) -> Self {
        Self(self.0 & !other.0)
    }

    /// Whether no flag is set.
    #[must_use]
    pub const fn is_empty(self) -> bool {
        self.0 == 0
    }
}

impl fmt::Display for OptionFlags {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        const NAMES: [(OptionFlags, &str); 5] = [
            (OptionFlags::TX_RESULT, "TX_RESULT"),
            (OptionFlags::ALIGN4, "ALIGN4"),
            (OptionFlags::NO_CRC16, "NO_CRC16"),
            (OptionFlags::APP_BYPASS, "APP_BYPASS"),
            (OptionFlags::PAYLOAD_ONLY, "PAYLOAD_ONLY"),
        ];
        let mut first = true;
        for (flag, name) in NAMES {
            if self.contains(flag) {
                write!(f, "{}{name}", if first { "" } else { "|" })?;
                first = false;
            }
        }
        if first { f.write_str("none") } else { Ok(()) }
    }
}

impl fmt::Debug for OptionFlags {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "OptionFlags({self})")
    }
}

/// What is wrong with a PDO profile.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ProfileError {
    /// N out of range.
    #[error("PDO size multiplier {0}, possible is 1 to 24")]
    Multiplier(u8),
    /// No channel, or one that does not exist.
    #[error("channel mask {0:#04x}, at least one of the channels 0 to 3 is needed and no other")]
    ChannelMask(u8),
    /// No such encapsulation profile.
    #[error("encapsulation profile {0}, possible are 0, 1, 4 and 5")]
    Encapsulation(u8),
    /// No such budget policy.
    #[error("budget policy {0}, possible is 0 to 2")]
    Budget(u8),
    /// TX_RESULT asked for in RxPDO.
    #[error("option TX_RESULT belongs to TxPDO and means nothing in RxPDO")]
    TxResultDirection,
    /// Reserved option bits.
    #[error("option flags {0:#04x}, the bits 5 to 7 are reserved")]
    Options(u8),
    /// Reserved bits in a profile word.
    #[error("profile word {0:#010x}, the bits 29 to 31 are reserved")]
    ReservedBits(u32),
}

/// The PDO profile of one direction, 0x8010:03..07 or 0x8011:03..07 (manual 13.2).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct PdoProfile {
    /// PDO size multiplier N, 1 to 24: the image has 128 times as many bytes.
    pub multiplier: u8,
    /// Channels that take part, bit 0 for channel 0.
    pub channel_mask: u8,
    /// How frames are packed.
    pub profile: EncapsulationProfile,
    /// How channels share the frame area.
    pub budget: BudgetPolicy,
    /// Options.
    pub options: OptionFlags,
}

/// What the device requests by itself: N = 8, channels 0 to 3, everything else 0.
impl Default for PdoProfile {
    fn default() -> Self {
        Self {
            multiplier: 8,
            channel_mask: EXISTING_CHANNELS,
            profile: EncapsulationProfile::Compact,
            budget: BudgetPolicy::Balanced,
            options: OptionFlags::NONE,
        }
    }
}

impl PdoProfile {
    /// Every fault of the profile in this direction.
    pub fn faults(&self, direction: Direction) -> impl Iterator<Item = ProfileError> + use<> {
        let multiplier = !(1..=MAX_MULTIPLIER).contains(&self.multiplier);
        let mask = self.channel_mask == 0 || self.channel_mask & !EXISTING_CHANNELS != 0;
        let result = direction == Direction::RxPdo && self.options.contains(OptionFlags::TX_RESULT);
        [
            multiplier.then_some(ProfileError::Multiplier(self.multiplier)),
            mask.then_some(ProfileError::ChannelMask(self.channel_mask)),
            result.then_some(ProfileError::TxResultDirection),
        ]
        .into_iter()
        .flatten()
    }

    /// Checks the profile for this direction.
    ///
    /// # Errors
    /// The first of [`faults`](Self::faults).
    pub fn check(&self, direction: Direction) -> Result<(), ProfileError> {
        match self.faults(direction).next() {
            Some(fault) => Err(fault),
            None => Ok(()),
        }
    }

    /// The profile word, as 0x8010:12 and 0x8011:12 echo it when active (manual 13.2).
    #[must_use]
    pub const fn word(&self) -> u32 {
        (self.multiplier.wrapping_sub(1) & 0x1F) as u32
            | (self.channel_mask as u32) << 5
            | (self.profile.raw() as u32) << 13
            | (self.budget.raw() as u32) << 19
            | (self.options.bits() as u32) << 21
    }

    /// Reads a profile word.
    ///
    /// # Errors
    /// [`ProfileError`] for the first field that has no meaning. The channel mask is taken as it
    /// is.
    pub const fn from_word(word: u32) -> Result<Self, ProfileError> {
        if word >> 29 != 0 {
            return Err(ProfileError::ReservedBits(word));
        }
        let multiplier = (word & 0x1F) as u8 + 1;
        if multiplier > MAX_MULTIPLIER {
            return Err(ProfileError::Multiplier(multiplier));
        }
        let encapsulation = (word >> 13 & 0x3F) as u8;
        let Some(profile) = EncapsulationProfile::from_raw(encapsulation) else {
            return Err(ProfileError::Encapsulation(encapsulation));
        };
        let policy = (word >> 19 & 3) as u8;
        let Some(budget) = BudgetPolicy::from_raw(policy) else {
            return Err(ProfileError::Budget(policy));
        };
        let bits = (word >> 21) as u8;
        let Some(options) = OptionFlags::from_bits(bits) else {
            return Err(ProfileError::Options(bits));
        };
        Ok(Self { multiplier, channel_mask: (word >> 5) as u8, profile, budget, options })
    }

    /// The short layout identifier in the image header, the profile word folded to 16 bits
    /// (manual 5.4.4.1).
    #[must_use]
    pub const fn layout_id(&self) -> u16 {
        let word = self.word();
        (word ^ word >> 16) as u16
    }

    /// Bytes of the image: 128 times N. A multiplier out of range counts as the nearest possible.
    #[must_use]
    pub const fn pdo_bytes(&self) -> usize {
        let multiplier = match self.multiplier {
            0 => 1,
            n if n > MAX_MULTIPLIER => MAX_MULTIPLIER,
            n => n,
        };
        multiplier as usize * CHUNK_BYTES
    }

    /// Bytes of the frame area: the image without its header.
    #[must_use]
    pub const fn frame_area_bytes(&self) -> usize {
        self.pdo_bytes() - HEADER_BYTES
    }

    /// Whether `channel` takes part.
    #[inline]
    #[must_use]
    pub const fn has_channel(&self, channel: u8) -> bool {
        channel < 8 && self.channel_mask & EXISTING_CHANNELS & 1 << channel != 0
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use std::string::ToString;
    use std::vec::Vec;

    #[test]
    fn every_legal_word_survives() {
        for multiplier in 1..=24 {
            for profile in EncapsulationProfile::ALL {
                for budget in 0..=2 {
                    for options in 0..=0x1F {
                        let value = PdoProfile {
                            multiplier,
                            channel_mask: 0x05,
                            profile,
                            budget: BudgetPolicy::from_raw(budget).unwrap(),
                            options: OptionFlags::from_bits(options).unwrap(),
                        };
                        assert_eq!(PdoProfile::from_word(value.word()), Ok(value));
                    }
                }
            }
        }
    }

    #[test]
    fn words_without_meaning_are_refused() {
        assert_eq!(PdoProfile::from_word(24), Err(ProfileError::Multiplier(25)));
        assert_eq!(PdoProfile::from_word(2 << 13), Err(ProfileError::Encapsulation(2)));
        assert_eq!(PdoProfile::from_word(3 << 19), Err(ProfileError::Budget(3)));
        assert_eq!(PdoProfile::from_word(0x20 << 21), Err(ProfileError::Options(0x20)));
        assert_eq!(PdoProfile::from_word(1 << 31), Err(ProfileError::ReservedBits(1 << 31)));
    }

    #[test]
    fn all_faults_are_reported() {
        let profile = PdoProfile {
            multiplier: 0,
            channel_mask: 0x10,
            options: OptionFlags::TX_RESULT,
            ..PdoProfile::default()
        };
        let faults: Vec<_> = profile.faults(Direction::RxPdo).collect();
        assert_eq!(
            faults,
            [
                ProfileError::Multiplier(0),
                ProfileError::ChannelMask(0x10),
                ProfileError::TxResultDirection
            ]
        );
        assert_eq!(profile.check(Direction::RxPdo), Err(faults[0]));
        assert_eq!(profile.faults(Direction::TxPdo).count(), 2);
        assert_eq!(PdoProfile::default().check(Direction::RxPdo), Ok(()));
    }

    #[test]
    fn options_are_named() {
        let options = OptionFlags::TX_RESULT.with(OptionFlags::ALIGN4);
        assert_eq!(options.to_string(), "TX_RESULT|ALIGN4");
        assert_eq!(OptionFlags::NONE.to_string(), "none");
        assert_eq!(OptionFlags::from_bits(0x20), None);
        assert_eq!(options.without(OptionFlags::ALIGN4), OptionFlags::TX_RESULT);
    }
}
