//! 0x8010 / 0x8011 PDO Profile Control (manual 5.2, 9, 12, 13.2).

use core::fmt;

use super::ObjectType::{U8, U16, U32};
use super::declare::object;
use super::entry::{Entry, Object};
use super::value::{KeyForm, raw_enum, raw_flags, status_enum};
use super::{ConfigObject, ObjectType, SdoWrite};
use crate::mapping::{CHUNK_BYTES, Direction, HEADER_BYTES, MAX_MULTIPLIER};

raw_enum! {
    /// Packing of the frames (manual 9).
    #[derive(Default)]
    pub enum EncapsulationProfile: u8, KeyForm::Number;
    /// Profile 0: data length by DLC, no timestamp. The device default.
    #[default]
    Compact = 0, "variable DLC, no timestamp";
    /// Profile 1: data length by DLC, timestamps allowed.
    CompactTimestamped = 1, "variable DLC, delta16 timestamp allowed";
    /// Profile 4: 64 byte data windows allowed, no timestamp.
    Window64 = 4, "D64 allowed, no timestamp";
    /// Profile 5: 64 byte data windows and timestamps allowed.
    Window64Timestamped = 5, "D64 allowed, delta16 timestamp allowed";
}

impl EncapsulationProfile {
    /// True if CAN FD data may use a fixed window of 64 bytes.
    pub const fn allows_d64(self) -> bool {
        matches!(self, Self::Window64 | Self::Window64Timestamped)
    }

    /// True if received frames may carry timestamps.
    pub const fn allows_delta16(self) -> bool {
        matches!(self, Self::CompactTimestamped | Self::Window64Timestamped)
    }
}

raw_enum! {
    /// Division of the frame area between the channels (manual 12).
    #[derive(Default)]
    pub enum BudgetPolicy: u8;
    /// A small reserve for each channel, the rest shared. The device default.
    #[default]
    Balanced = 0, "balanced";
    /// No reserve, everything shared.
    SharedOnly = 1, "shared only";
    /// Equal parts for the enabled channels, nothing shared.
    Deterministic = 2, "deterministic";
}

/// Options of a direction, 0x8010:07 and 0x8011:07 (manual 9.1). The device default is none.
#[derive(Clone, Copy, Default, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct OptionFlags(u8);

raw_flags! {
    OptionFlags: u8;
    /// The gateway reports the result of each sent frame. No meaning in RxPDO.
    TX_RESULT = 0, "TX_RESULT_ENABLE";
    /// Packets are padded to 4 bytes.
    ALIGN4 = 1, "ALIGN_4_ENABLE";
    /// The header carries no CRC. For performance isolation tests.
    NO_CRC16 = 2, "NO_CRC16_ENABLE";
    /// The CAN side is disconnected. For tests.
    APP_BYPASS = 3, "APP_BYPASS_ENABLE";
    /// Bytes after the payload are not written.
    PAYLOAD_ONLY = 4, "PAYLOAD_ONLY_ENABLE";
}

impl OptionFlags {
    /// No option.
    pub const NONE: Self = Self(0);

    /// Returns the flags with these bits; `None` if a reserved bit (5 to 7) is set.
    pub const fn from_bits(bits: u8) -> Option<Self> {
        if bits & !Self::ALL.0 == 0 { Some(Self(bits)) } else { None }
    }

    /// The bits.
    pub const fn bits(self) -> u8 {
        self.0
    }

    /// True if all flags of `other` are set.
    pub const fn contains(self, other: Self) -> bool {
        self.0 & other.0 == other.0
    }

    /// These flags and those of `other`.
    #[must_use]
    pub const fn with(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }

    /// These flags without those of `other`.
    #[must_use]
    pub const fn without(self, other: Self) -> Self {
        Self(self.0 & !other.0)
    }

    /// True if no flag is set.
    pub const fn is_empty(self) -> bool {
        self.0 == 0
    }
}

impl fmt::Display for OptionFlags {
    /// `TX_RESULT|ALIGN4`, or `none`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.is_empty() {
            return f.write_str("none");
        }
        let mut separator = "";
        for (name, bit) in Self::NAMES {
            if u32::from(self.0) & bit != 0 {
                write!(f, "{separator}{name}")?;
                separator = "|";
            }
        }
        Ok(())
    }
}

impl fmt::Debug for OptionFlags {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "OptionFlags({self})")
    }
}

status_enum! {
    /// Status of a profile (0x8010:02, 0x8011:02).
    pub enum ProfileStatus;
    /// The requested profile is active, or nothing was requested yet.
    Ok = 0, "OK";
    InvalidState = 1, "invalid state, the layout cannot change in OP";
    /// N is not 1 to 24.
    InvalidMultiplier = 2, "invalid PDO size multiplier";
    InvalidChannelMask = 3, "invalid channel mask";
    InvalidProfile = 4, "invalid encapsulation profile";
    /// N and the assigned chunks differ; the old profile stays active.
    MappingReloadRequired = 5,
        "master mapping reload required: PDO assignment and size multiplier differ";
    EncapsulationError = 7, "PDO encapsulation error";
    /// Frames did not fit or were delayed.
    Overflow = 8, "PDO overflow or backpressure";
    /// A profile was written but not applied.
    PendingApply = 9, "requested profile pending apply";
    UnsupportedOption = 10, "unsupported option flag";
}

const CHANNELS: &[(u8, &str)] = &[(0, "CAN0"), (1, "CAN1"), (2, "CAN2"), (3, "CAN3")];

const LAST_ERROR: &[(u32, &str)] = &[
    (0, "OK"),
    (2, "frame overrun"),
    (3, "packet overrun"),
    (4, "unknown kind"),
    (5, "invalid DLC"),
    (6, "invalid channel"),
    (7, "invalid TSF"),
    (8, "truncated"),
    (9, "unsupported profile"),
    (10, "duplicate sequence"),
    (11, "unsupported option"),
    (12, "active area"),
    (13, "reserved bit"),
    (14, "bad header"),
    (15, "bad CRC"),
    (16, "bad schedule"),
];

/// Subindex of the command for the session.
const SESSION_COMMAND: u8 = 8;

object! {
    /// PDO profile of one direction: the fields of 0x8010 or 0x8011 (manual 13.2).
    ///
    /// The default is the device's: N = 8, channels 0 to 3, everything else 0.
    #[derive(Hash)]
    pub struct PdoProfile {}
    const TX_PDO_PROFILE =
        Object::single(0x8010, "TxPDO Profile Control", "13.2", PdoProfile::ENTRIES)
            .applied_by(1, 2)
            .saved_except(&[SESSION_COMMAND]);
    const RX_PDO_PROFILE =
        Object::single(0x8011, "RxPDO Profile Control", "13.2", PdoProfile::ENTRIES)
            .applied_by(1, 2)
            .saved_except(&[SESSION_COMMAND]);
    entries {
        entry(Entry::highest(16));
        entry(Entry::rw(1, "Apply command", U8).default(0).values(&[(0, "no-op"), (1, "apply")]));
        entry(Entry::ro(2, "Status", U8).default(0).values(ProfileStatus::VALUES));
        /// PDO size multiplier N, 1 to 24 (:03): the image has 128 * N bytes.
        3 "PDO size multiplier" multiplier: u8 = 8, range(1, 24), unit("128 bytes"), key("n");
        /// Enabled channels (:04), bit 0 for channel 0.
        4 "Channel mask" channel_mask: u8 = 0x0F, range(0, 0x0F), bits(CHANNELS),
            key("channels"), form(KeyForm::Bits);
        /// Packing of the frames (:05).
        5 "Encapsulation profile" profile: EncapsulationProfile = EncapsulationProfile::Compact;
        /// Division of the frame area between the channels (:06).
        6 "Budget policy" budget: BudgetPolicy = BudgetPolicy::Balanced;
        /// Options (:07).
        7 "Option flags" options: OptionFlags = OptionFlags::NONE;
        entry(Entry::rw(SESSION_COMMAND, "Command", U8).default(0).range(0, 3)
            .bits(&[(0, "reset session"), (1, "clear errors")]));
        entry(Entry::ro(9, "Active PDO bytes", U16).default(0).unit("bytes"));
        entry(Entry::ro(10, "Active frame area bytes", U16).default(0).unit("bytes"));
        entry(Entry::ro(11, "Active layout CRC", U32).default(0));
        entry(Entry::ro(12, "Active profile word", U32).default(0));
        entry(Entry::ro(13, "Packet sequence", U16).default(0));
        entry(Entry::ro(14, "Last PDO error", U16).default(0).values(LAST_ERROR));
        entry(Entry::ro(15, "PDO error counter", U32).default(0));
        entry(Entry::ro(16, "PDO overflow counter", U32).default(0));
    }
}

impl PdoProfile {
    /// Subindex of N in 0x8010 and 0x8011.
    pub const MULTIPLIER: u8 = 3;
    /// Subindex of the channel mask.
    pub const CHANNEL_MASK: u8 = 4;

    /// Returns the downloads of the requested profile, :03 to :07 (manual 5.4.3 C1..C5, C7..C11).
    /// They take effect with [`apply_write`](Self::apply_write).
    pub fn writes(&self, direction: Direction) -> impl Iterator<Item = SdoWrite> + use<> {
        self.writes_to(direction.profile_object())
    }

    /// The download that applies the requested profile of a direction: :01 = 1.
    pub const fn apply_write(direction: Direction) -> SdoWrite {
        SdoWrite::new(direction.profile_object(), 1, ObjectType::U8, 1)
    }
}

/// Command of a direction (0x8010:08, 0x8011:08).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum SessionCommand {
    /// Resets sequence number and errors of the direction.
    ResetSession = 1,
    /// Clears last error and counters.
    ClearErrors = 2,
    /// Both.
    ResetAndClear = 3,
}

/// The download of a [`SessionCommand`] to a direction.
pub const fn session_command_write(direction: Direction, command: SessionCommand) -> SdoWrite {
    SdoWrite::new(direction.profile_object(), SESSION_COMMAND, ObjectType::U8, command as u32)
}

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

/// Bytes that the balanced policy reserves for each enabled channel: the largest packet of a classic frame without
/// timestamp, padded. The manual specifies only "a minimum packet budget" (docs/ASSUMPTIONS.md, H7).
const BALANCED_RESERVE_BYTES: usize = 16;

/// Division of the frame area of one image among the channels, by its budget policy (manual 12).
///
/// A channel uses its own reserve, then the shared bytes. With `Deterministic` nothing is shared, with `SharedOnly`
/// nothing is reserved.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FrameBudget {
    reserved: [u16; crate::mapping::CHANNELS],
    shared: u16,
    policy: BudgetPolicy,
}

impl FrameBudget {
    /// The budget of an empty image.
    pub fn new(profile: &PdoProfile) -> Self {
        let area = profile.frame_area_bytes();
        let enabled = (profile.channel_mask & EXISTING_CHANNELS).count_ones().max(1) as usize;
        let reserve = match profile.budget {
            BudgetPolicy::Balanced => BALANCED_RESERVE_BYTES.min(area / enabled),
            BudgetPolicy::SharedOnly => 0,
            BudgetPolicy::Deterministic => area / enabled,
        };
        let shared = match profile.budget {
            BudgetPolicy::Deterministic => 0,
            _ => area - reserve * enabled,
        };
        // infallible: a frame area has at most 3048 bytes
        let reserved = |at| if profile.has_channel(at as u8) { reserve as u16 } else { 0 };
        let policy = profile.budget;
        Self { reserved: core::array::from_fn(reserved), shared: shared as u16, policy }
    }

    /// Bytes left for a channel; 0 for one that does not exist.
    #[inline]
    pub fn left(&self, channel: u8) -> usize {
        self.reserved
            .get(usize::from(channel))
            .map_or(0, |reserved| usize::from(*reserved) + usize::from(self.shared))
    }

    /// Takes the bytes of a packet that was added for a channel; at most those that are [left](Self::left).
    #[inline]
    pub fn take(&mut self, channel: u8, bytes: usize) {
        let Some(reserved) = self.reserved.get_mut(usize::from(channel)) else { return };
        let bytes = u16::try_from(bytes).unwrap_or(u16::MAX);
        let from_own = bytes.min(*reserved);
        *reserved -= from_own;
        self.shared = self.shared.saturating_sub(bytes - from_own);
    }

    /// Makes the reserves that are left common, when all channels were served; only `Balanced` lends them. Returns
    /// whether there were any.
    pub fn release_reserves(&mut self) -> bool {
        if self.policy != BudgetPolicy::Balanced {
            return false;
        }
        let left: u16 = core::mem::take(&mut self.reserved).iter().sum();
        self.shared += left;
        left > 0
    }
}

#[cfg(test)]
mod tests {
    use std::string::ToString;
    use std::vec::Vec;

    use super::*;

    extern crate std;

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

    /// Manual 12: frame area 360 bytes at N = 3.
    #[test]
    fn budget_divides_the_frame_area_by_its_policy() {
        let budget = |budget, channel_mask| {
            let profile =
                PdoProfile { multiplier: 3, channel_mask, budget, ..PdoProfile::default() };
            FrameBudget::new(&profile)
        };
        for (policy, left, left_after) in [
            (BudgetPolicy::Balanced, [312, 312, 312, 312], [276, 292, 292, 292]),
            (BudgetPolicy::SharedOnly, [360, 360, 360, 360], [324, 324, 324, 324]),
            (BudgetPolicy::Deterministic, [90, 90, 90, 90], [54, 90, 90, 90]),
        ] {
            let mut budget = budget(policy, 0x0F);
            let lefts = |budget: &FrameBudget| [0, 1, 2, 3].map(|channel| budget.left(channel));
            assert_eq!(lefts(&budget), left, "{policy}");
            budget.take(0, 36);
            assert_eq!(lefts(&budget), left_after, "{policy}");
        }
        let one = [BudgetPolicy::Balanced, BudgetPolicy::SharedOnly, BudgetPolicy::Deterministic]
            .map(|policy| budget(policy, 0x02).left(1));
        assert_eq!(one, [360; 3], "one channel has the whole area");
        let mut balanced = budget(BudgetPolicy::Balanced, 0x03);
        assert!(balanced.release_reserves() && !balanced.release_reserves());
        assert_eq!((balanced.left(0), balanced.left(4)), (360, 0));
        assert!(!budget(BudgetPolicy::Deterministic, 0x03).release_reserves());
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
