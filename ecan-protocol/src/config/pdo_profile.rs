//! PDO profiles as SDO downloads, and their readback (manual 5.4.3 phases C and D, 13.2).

use core::fmt;

use crate::image::PdoProfile;
use crate::mapping::Direction;
use crate::object::ObjectType;
use crate::object::SdoWrite;

/// Number of downloads of [`PdoProfile::writes`].
pub const PDO_PROFILE_WRITES: usize = 5;

impl PdoProfile {
    /// The downloads of the requested profile, :03..:07 (manual 5.4.3 C1..C5, C7..C11). They
    /// take effect with [`apply_write`](Self::apply_write).
    pub const fn writes(&self, direction: Direction) -> [SdoWrite; PDO_PROFILE_WRITES] {
        let index = direction.profile_object();
        [
            SdoWrite::new(index, 3, ObjectType::U8, self.multiplier as u32),
            SdoWrite::new(index, 4, ObjectType::U8, self.channel_mask as u32),
            SdoWrite::new(index, 5, ObjectType::U8, self.profile.raw() as u32),
            SdoWrite::new(index, 6, ObjectType::U8, self.budget.raw() as u32),
            SdoWrite::new(index, 7, ObjectType::U8, self.options.bits() as u32),
        ]
    }

    /// The download that applies the requested profile of a direction: :01 = 1.
    pub const fn apply_write(direction: Direction) -> SdoWrite {
        SdoWrite::new(direction.profile_object(), 1, ObjectType::U8, 1)
    }

    /// Compares what a gateway reports with this profile (manual 5.4.3 D1..D8) and reports every
    /// difference.
    pub fn verify(&self, readback: &ProfileReadback, report: &mut dyn FnMut(ProfileMismatch)) {
        if readback.status != ProfileStatus::Ok {
            report(ProfileMismatch::Status(readback.status));
        }
        let expected = self.pdo_bytes() as u16;
        if readback.pdo_bytes != expected {
            report(ProfileMismatch::PdoBytes { expected, found: readback.pdo_bytes });
        }
        let expected = self.frame_area_bytes() as u16;
        if readback.frame_area_bytes != expected {
            report(ProfileMismatch::FrameAreaBytes { expected, found: readback.frame_area_bytes });
        }
        let expected = self.word();
        if readback.profile_word != expected {
            report(ProfileMismatch::ProfileWord { expected, found: readback.profile_word });
        }
    }
}

/// The active profile of a direction as the gateway reports it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ProfileReadback {
    /// :02 Status.
    pub status: ProfileStatus,
    /// :09 Active PDO bytes.
    pub pdo_bytes: u16,
    /// :10 Active frame area bytes.
    pub frame_area_bytes: u16,
    /// :12 Active profile word.
    pub profile_word: u32,
}

impl ProfileReadback {
    /// The subindices to read, in ascending order.
    pub const SUBINDICES: [u8; 4] = [2, 9, 10, 12];

    /// Reads the four values through `read`, which gets a subindex and uploads it from the
    /// direction's object.
    ///
    /// # Errors
    /// The first error of `read`.
    pub fn read<E>(mut read: impl FnMut(u8) -> Result<u32, E>) -> Result<Self, E> {
        Ok(Self {
            status: ProfileStatus::from_raw(read(2)? as u8),
            pdo_bytes: read(9)? as u16,
            frame_area_bytes: read(10)? as u16,
            profile_word: read(12)?,
        })
    }
}

/// A difference between the requested and the active profile.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ProfileMismatch {
    /// The profile was not applied.
    #[error("profile status {0}")]
    Status(ProfileStatus),
    /// :09 differs.
    #[error("{found} active PDO bytes instead of {expected}")]
    PdoBytes {
        /// Bytes of the requested profile.
        expected: u16,
        /// Bytes that the gateway reports.
        found: u16,
    },
    /// :10 differs.
    #[error("{found} active frame area bytes instead of {expected}")]
    FrameAreaBytes {
        /// Bytes of the requested profile.
        expected: u16,
        /// Bytes that the gateway reports.
        found: u16,
    },
    /// :12 differs.
    #[error("active profile word 0x{found:08X} instead of 0x{expected:08X}")]
    ProfileWord {
        /// Word of the requested profile.
        expected: u32,
        /// Word that the gateway reports.
        found: u32,
    },
}

/// 0x8010:02 / 0x8011:02 Status.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum ProfileStatus {
    /// The requested profile is active, or nothing was requested yet.
    Ok,
    /// The layout cannot change in this state, usually OP.
    InvalidState,
    /// N is not 1..24.
    InvalidMultiplier,
    /// The mask names no channel or one that does not exist.
    InvalidChannelMask,
    /// The encapsulation profile is not supported.
    InvalidProfile,
    /// N and the assigned chunks differ; the old profile stays active.
    MappingReloadRequired,
    /// The last image had an encapsulation error.
    EncapsulationError,
    /// Frames did not fit or were held up.
    Overflow,
    /// A profile was written but not applied.
    PendingApply,
    /// An option flag is not supported.
    UnsupportedOption,
    /// A number that the manual does not list.
    Unknown(u8),
}

impl ProfileStatus {
    /// The status for the gateway's number.
    pub const fn from_raw(raw: u8) -> Self {
        match raw {
            0 => Self::Ok,
            1 => Self::InvalidState,
            2 => Self::InvalidMultiplier,
            3 => Self::InvalidChannelMask,
            4 => Self::InvalidProfile,
            5 => Self::MappingReloadRequired,
            7 => Self::EncapsulationError,
            8 => Self::Overflow,
            9 => Self::PendingApply,
            10 => Self::UnsupportedOption,
            other => Self::Unknown(other),
        }
    }

    /// The gateway's number.
    pub const fn raw(self) -> u8 {
        match self {
            Self::Ok => 0,
            Self::InvalidState => 1,
            Self::InvalidMultiplier => 2,
            Self::InvalidChannelMask => 3,
            Self::InvalidProfile => 4,
            Self::MappingReloadRequired => 5,
            Self::EncapsulationError => 7,
            Self::Overflow => 8,
            Self::PendingApply => 9,
            Self::UnsupportedOption => 10,
            Self::Unknown(raw) => raw,
        }
    }
}

impl fmt::Display for ProfileStatus {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        super::write_status(
            f,
            self.raw(),
            match self {
                Self::Ok => Some("OK"),
                Self::InvalidState => Some("the layout cannot change in this state"),
                Self::InvalidMultiplier => Some("invalid PDO size multiplier"),
                Self::InvalidChannelMask => Some("invalid channel mask"),
                Self::InvalidProfile => Some("invalid encapsulation profile"),
                Self::MappingReloadRequired => Some("PDO assignment and size multiplier differ"),
                Self::EncapsulationError => Some("PDO encapsulation error"),
                Self::Overflow => Some("PDO overflow or backpressure"),
                Self::PendingApply => Some("requested profile not applied"),
                Self::UnsupportedOption => Some("unsupported option flag"),
                Self::Unknown(_) => None,
            },
        )
    }
}

/// What 0x8010:08 / 0x8011:08 Command does.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum SessionCommand {
    /// Forget sequence number and errors of the direction.
    ResetSession,
    /// Clear last error and counters.
    ClearErrors,
    /// Both.
    ResetAndClear,
}

/// The download of a [`SessionCommand`] to a direction.
pub const fn session_command_write(direction: Direction, command: SessionCommand) -> SdoWrite {
    let bits = match command {
        SessionCommand::ResetSession => 1,
        SessionCommand::ClearErrors => 2,
        SessionCommand::ResetAndClear => 3,
    };
    SdoWrite::new(direction.profile_object(), 8, ObjectType::U8, bits)
}
