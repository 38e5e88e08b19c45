//! PDO profiles as SDO downloads, and their readback (manual 5.4.3 phases C and D, 13.2).

use crate::mapping::Direction;
use crate::object::pdo_profile::{PdoProfile, ProfileStatus};
use crate::object::{ConfigObject, ObjectType, SdoWrite};

impl PdoProfile {
    /// Returns the downloads of the requested profile, :03 to :07 (manual 5.4.3 C1..C5, C7..C11).
    /// They take effect with [`apply_write`](Self::apply_write).
    pub fn writes(&self, direction: Direction) -> impl Iterator<Item = SdoWrite> + use<> {
        self.writes_to(direction.profile_object())
    }

    /// The download that applies the requested profile of a direction: :01 = 1.
    pub const fn apply_write(direction: Direction) -> SdoWrite {
        SdoWrite::new(direction.profile_object(), 1, ObjectType::U8, 1)
    }

    /// Compares the readback of a gateway with this profile (manual 5.4.3 D1..D8) and reports every
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

    /// Reads the four values; `read` gets a subindex of the direction's object.
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

/// Command of a direction (0x8010:08, 0x8011:08).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum SessionCommand {
    /// Resets sequence number and errors of the direction.
    ResetSession,
    /// Clears last error and counters.
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
