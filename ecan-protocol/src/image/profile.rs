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
    /// TX_RESULT requested for RxPDO.
    #[error("option TX_RESULT has no meaning in RxPDO; set it for TxPDO")]
    TxResultDirection,
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
    pub const fn word(&self) -> u32 {
        (self.multiplier.wrapping_sub(1) & 0x1F) as u32
            | (self.channel_mask as u32) << 5
            | (self.profile.raw() as u32) << 13
            | (self.budget.raw() as u32) << 19
            | (self.options.bits() as u32) << 21
    }

    /// The profile of a [`word`](Self::word); `None` if a field has no meaning or an unused bit is set.
    pub const fn from_word(word: u32) -> Option<Self> {
        let (profile, budget) = (
            EncapsulationProfile::from_raw((word >> 13) as u8 & 0x3F),
            BudgetPolicy::from_raw((word >> 19) as u8 & 0x03),
        );
        let options = (word >> 21) as u16;
        let options = if options > 0xFF { None } else { OptionFlags::from_bits(options as u8) };
        match (profile, budget, options) {
            (Some(profile), Some(budget), Some(options)) => Some(Self {
                multiplier: (word & 0x1F) as u8 + 1,
                channel_mask: (word >> 5) as u8,
                profile,
                budget,
                options,
            }),
            _ => None,
        }
    }

    /// The short layout identifier in the image header, the profile word folded to 16 bits
    /// (manual 5.4.4.1).
    pub const fn layout_id(&self) -> u16 {
        let word = self.word();
        (word ^ word >> 16) as u16
    }

    /// Bytes of the image: 128 times N. A multiplier out of range counts as the nearest valid one.
    pub const fn pdo_bytes(&self) -> usize {
        let multiplier = match self.multiplier {
            0 => 1,
            n if n > MAX_MULTIPLIER => MAX_MULTIPLIER,
            n => n,
        };
        multiplier as usize * CHUNK_BYTES
    }

    /// Bytes of the frame area: the image without its header.
    pub const fn frame_area_bytes(&self) -> usize {
        self.pdo_bytes() - HEADER_BYTES
    }

    /// True if `channel` is enabled.
    #[inline]
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
    fn profile_word_has_the_fields_of_the_manual() {
        let profile = PdoProfile {
            multiplier: 24,
            channel_mask: 0x05,
            profile: EncapsulationProfile::Window64Timestamped,
            budget: BudgetPolicy::Deterministic,
            options: OptionFlags::ALL,
        };
        assert_eq!(profile.word(), 23 | 0x05 << 5 | 5 << 13 | 2 << 19 | 0x1F << 21);
        assert_eq!(PdoProfile::from_word(profile.word()), Some(profile));
    }

    #[test]
    fn word_with_unknown_fields_is_rejected() {
        let word = PdoProfile::default().word();
        assert_eq!(PdoProfile::from_word(word), Some(PdoProfile::default()));
        for wrong in [9 << 13, 3 << 19, 0x20 << 21, 1 << 31] {
            assert_eq!(PdoProfile::from_word(word | wrong), None, "{wrong:#x}");
        }
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
