//! 0xB000 Device Maintenance: access modes, commands and statuses (manual 13.7).

use super::ObjectType::{U8, U16, U32};
use super::entry::{Entry, Object};
use super::{raw_enum, status_enum};

const MODE: &[(u32, &str)] = &[(0, "run"), (1, "engineering"), (2, "factory")];

pub(super) const MAINTENANCE: Object = Object::single(
    0xB000,
    "Device Maintenance",
    "13.7",
    &[
        Entry::highest(12),
        Entry::rw(1, "Access mode request", U8).range(0, 2).values(MODE),
        Entry::ro(2, "Access status", U8).values(MODE),
        Entry::rw(3, "Access timeout s", U16).unit("s"),
        Entry::wo(4, "Maintenance command", U8).range(0, 0x7F).bits(&[
            (0, "save configuration"),
            (1, "load configuration"),
            (2, "restore factory defaults"),
            (3, "validate FoE image"),
            (4, "activate FoE image"),
            (5, "clear diagnostics"),
            (6, "rebuild EEPROM and reboot"),
        ]),
        // The manual gives numbers to these two only.
        Entry::ro(5, "Maintenance status", U8).values(&[(0, "OK"), (2, "denied")]),
        Entry::ro(6, "Legacy maintenance diag flags", U16).bits(&[
            (0, "SHADOW_FALLBACK"),
            (1, "SHADOW_COPY_RETRY"),
            (2, "SHADOW_SIZE_CHANGE"),
            (3, "RXPDO_STAGE_DROP"),
            (4, "TX_RING_DROP"),
            (5, "TX_FIFO_FULL"),
            (6, "SCHED_LATE_DROP"),
            (7, "SCHED_QUEUE_FULL"),
            (8, "SCHED_TX_FAIL"),
            (9, "SCHED_TIMER_MISS"),
        ]),
        Entry::ro(7, "Active config CRC32", U32),
        Entry::ro(8, "Stored config CRC32", U32),
        Entry::ro(9, "FoE image size", U32).unit("bytes"),
        Entry::ro(10, "FoE image CRC32", U32),
        Entry::ro(11, "FoE status code", U32),
        Entry::ro(12, "Maintenance sequence", U32),
    ],
);

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
