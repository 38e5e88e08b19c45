//! Access modes, commands and statuses of 0xB000 Device Maintenance (manual 13.7).

use crate::object::{raw_enum, status_enum};

raw_enum! {
    /// Access mode of a gateway (0xB000:01, :02).
    #[derive(Default, PartialOrd, Ord)]
    pub enum AccessMode: u8;
    /// Normal operation.
    #[default]
    Run = 0, "run";
    /// Enables some maintenance functions.
    Engineering = 1, "engineering";
    /// Factory maintenance.
    Factory = 2, "factory";
}

raw_enum! {
    /// A single maintenance command (0xB000:04).
    pub enum MaintenanceCommand: u8;
    /// Saves the active configuration to the flash.
    Save = 0x01, "save configuration";
    Load = 0x02, "load configuration";
    Factory = 0x04, "restore factory defaults";
    Validate = 0x08, "validate FoE image";
    Activate = 0x10, "activate FoE image";
    ClearDiagnostics = 0x20, "clear diagnostics";
    /// Erases the emulated EEPROM and restarts.
    RebuildEeprom = 0x40, "rebuild EEPROM and reboot";
}

status_enum! {
    /// Result of a maintenance command (0xB000:05).
    ///
    /// The manual gives numbers only to 0 and 2; the others follow the order in which it names them.
    #[derive(Default)]
    pub enum MaintenanceStatus;
    /// Done.
    #[default]
    Ok = 0, "OK";
    Busy = 1, "busy: another command is in progress";
    Denied = 2, "denied: the state (OP) or the access mode does not permit it";
    CrcError = 3, "CRC error: the stored data is damaged";
    ImageInvalid = 4, "image invalid: nothing is stored, or the firmware cannot use it";
    FlashError = 5, "Flash error: the Flash could not be written";
}
