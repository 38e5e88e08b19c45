//! 0x8010 / 0x8011 PDO Profile Control (manual 5.2, 9, 12, 13.2).

use core::fmt;

use super::ObjectType::{U8, U16, U32};
use super::declare::object;
use super::entry::{Entry, Object};
use super::value::{KeyForm, raw_enum, raw_flags, status_enum};

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

object! {
    /// PDO profile of one direction: the fields of 0x8010 or 0x8011 (manual 13.2).
    ///
    /// The default is the device's: N = 8, channels 0 to 3, everything else 0.
    #[derive(Hash)]
    pub struct PdoProfile {}
    const TX_PDO_PROFILE =
        Object::single(0x8010, "TxPDO Profile Control", "13.2", PdoProfile::ENTRIES)
            .applied_by(1, 2)
            .saved();
    const RX_PDO_PROFILE =
        Object::single(0x8011, "RxPDO Profile Control", "13.2", PdoProfile::ENTRIES)
            .applied_by(1, 2)
            .saved();
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
        entry(Entry::rw(8, "Command", U8).default(0).range(0, 3)
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
