//! Access modes, commands and statuses of 0xB000 Device Maintenance (manual 13.7).

use core::fmt;

use crate::raw_enum::raw_enum;

raw_enum! {
    /// Access mode of a gateway (0xB000:01, :02).
    #[derive(Default, PartialOrd, Ord)]
    pub enum AccessMode: u8 {
        /// Normal operation.
        #[default]
        Run = 0,
        /// Opens some functions of maintenance.
        Engineering = 1,
        /// Factory maintenance.
        Factory = 2,
    }
}

impl fmt::Display for AccessMode {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Run => "run",
            Self::Engineering => "engineering",
            Self::Factory => "factory",
        })
    }
}

raw_enum! {
    /// A maintenance command (0xB000:04), alone.
    pub enum MaintenanceCommand: u8 {
        /// Saves the configuration that is in force to the Flash.
        Save = 0x01,
        /// Loads the saved configuration.
        Load = 0x02,
        /// Restores the configuration of the factory.
        Factory = 0x04,
        /// Validates a firmware image that came by FoE.
        Validate = 0x08,
        /// Activates a firmware image that came by FoE.
        Activate = 0x10,
        /// Clears runtime diagnostics and diagnostic flags.
        ClearDiagnostics = 0x20,
        /// Erases the emulated EEPROM and restarts.
        RebuildEeprom = 0x40,
    }
}

/// How a maintenance command ended (0xB000:05).
///
/// The manual gives numbers to 0 and 2 alone; the others follow the order in which it names them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum MaintenanceStatus {
    /// Done.
    #[default]
    Ok,
    /// Another command is under way.
    Busy,
    /// Not in this state, or not in this access mode.
    Denied,
    /// What is stored is damaged.
    CrcError,
    /// Nothing that could be used is stored.
    ImageInvalid,
    /// The Flash failed.
    FlashError,
    /// A number that the manual does not list.
    Unknown(u8),
}

impl MaintenanceStatus {
    /// The status for the gateway's number.
    pub const fn from_raw(raw: u8) -> Self {
        match raw {
            0 => Self::Ok,
            1 => Self::Busy,
            2 => Self::Denied,
            3 => Self::CrcError,
            4 => Self::ImageInvalid,
            5 => Self::FlashError,
            other => Self::Unknown(other),
        }
    }

    /// The gateway's number.
    pub const fn raw(self) -> u8 {
        match self {
            Self::Ok => 0,
            Self::Busy => 1,
            Self::Denied => 2,
            Self::CrcError => 3,
            Self::ImageInvalid => 4,
            Self::FlashError => 5,
            Self::Unknown(raw) => raw,
        }
    }
}

impl fmt::Display for MaintenanceStatus {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let words = match self {
            Self::Ok => "OK",
            Self::Busy => "busy: another command is under way",
            Self::Denied => "denied: the state (OP) or the access mode does not permit it",
            Self::CrcError => "CRC error: what is stored is damaged",
            Self::ImageInvalid => "image invalid: nothing is stored, or the firmware cannot use it",
            Self::FlashError => "Flash error: the Flash could not be written",
            Self::Unknown(_) => "not in the manual",
        };
        write!(f, "{} ({words})", self.raw())
    }
}
