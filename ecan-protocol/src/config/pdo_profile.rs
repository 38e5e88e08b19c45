//! PDO profiles as SDO downloads (manual 5.4.3 phase C, 13.2).

use crate::mapping::Direction;
use crate::object::pdo_profile::PdoProfile;
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
    SdoWrite::new(direction.profile_object(), 8, ObjectType::U8, command as u32)
}
