//! Checks, sizes and the profile word of a [`PdoProfile`] (manual 5.2, 5.4.4.1, 13.2).

use crate::mapping::{CHUNK_BYTES, Direction, HEADER_BYTES, MAX_MULTIPLIER};
use crate::object::pdo_profile::{BudgetPolicy, EncapsulationProfile, OptionFlags, PdoProfile};

/// Channels that exist, as a mask.
const EXISTING_CHANNELS: u8 = 0x0F;

/// A fault of a PDO profile.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ProfileError {
    /// N is out of range.
    #[error("PDO size multiplier {0} is out of range; allowed: 1 to 24")]
    Multiplier(u8),
    /// No channel, or one that does not exist.
    #[error("channel mask {0:#04x} is invalid; allowed: 0x01 to 0x0f, the channels 0 to 3")]
    ChannelMask(u8),
    /// No such encapsulation profile.
    #[error("encapsulation profile {0} is invalid; allowed: 0, 1, 4, 5")]
    Encapsulation(u8),
    /// No such budget policy.
    #[error("budget policy {0} is out of range; allowed: 0 to 2")]
    Budget(u8),
    /// TX_RESULT requested for RxPDO.
    #[error("option TX_RESULT has no meaning in RxPDO; set it for TxPDO")]
    TxResultDirection,
    /// Reserved option bits.
    #[error("option flags {0:#04x} are invalid; bits 5 to 7 are reserved")]
    Options(u8),
    /// Reserved bits in a profile word.
    #[error("profile word {0:#010x} is invalid; bits 29 to 31 are reserved")]
    ReservedBits(u32),
}

impl PdoProfile {
    /// Returns every fault of the profile in this direction.
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

    /// The profile word, as 0x8010:12 and 0x8011:12 return it when active (manual 13.2).
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
    /// [`ProfileError`] for the first field that has no meaning. The channel mask is not checked.
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

    /// Bytes of the image: 128 times N. A multiplier out of range counts as the nearest valid one.
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

    /// True if `channel` is enabled.
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
    fn profile_word_round_trip() {
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
    fn invalid_profile_word_returns_error() {
        assert_eq!(PdoProfile::from_word(24), Err(ProfileError::Multiplier(25)));
        assert_eq!(PdoProfile::from_word(2 << 13), Err(ProfileError::Encapsulation(2)));
        assert_eq!(PdoProfile::from_word(3 << 19), Err(ProfileError::Budget(3)));
        assert_eq!(PdoProfile::from_word(0x20 << 21), Err(ProfileError::Options(0x20)));
        assert_eq!(PdoProfile::from_word(1 << 31), Err(ProfileError::ReservedBits(1 << 31)));
    }

    #[test]
    fn check_reports_all_faults() {
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
    fn options_display_names() {
        let options = OptionFlags::TX_RESULT.with(OptionFlags::ALIGN4);
        assert_eq!(options.to_string(), "TX_RESULT|ALIGN4");
        assert_eq!(OptionFlags::NONE.to_string(), "none");
        assert_eq!(OptionFlags::from_bits(0x20), None);
        assert_eq!(options.without(OptionFlags::ALIGN4), OptionFlags::TX_RESULT);
    }
}
