//! The gateway as a whole: 0x8000 System Config and 0xB000 Device Maintenance (manual 13.3, 13.7), and the
//! configuration of every object that belongs to no channel and no direction.

use super::ObjectType::{U8, U16, U32};
use super::data_path::{DataPathFault, DataPathGlobal};
use super::declare::{ConfigObject, InvalidValue, RangeFault, SdoWrite};
use super::diagnostic_test::{DiagnosticFault, DiagnosticTest};
use super::entry::{Entry, Object};
use super::{raw_enum, status_enum};

const SYSTEM_INDEX: u16 = 0x8000;
const MAINTENANCE_INDEX: u16 = 0xB000;
const CPU_VOLTAGE: u8 = 3;
const CONFIG_VERSION: u8 = 10;
const ROTATION_MASK: u8 = 14;
const ROTATION_STATUS: u8 = 15;
const ACCESS_TIMEOUT: u8 = 3;

pub(super) const SYSTEM: Object = Object::single(
    SYSTEM_INDEX,
    "System Config",
    "13.3",
    &[
        Entry::highest(15),
        Entry::wo(1, "Reboot command", U8).default(0).values(&[(0, "no-op"), (1, "restart")]),
        Entry::rw(CPU_VOLTAGE, "CPU voltage", U16).default(1275).unit("mV").key("cpu_voltage_mv"),
        Entry::ro(4, "CPU clock hz", U32).default(400_000_000).unit("Hz"),
        Entry::ro(5, "BUS clock hz", U32).default(200_000_000).unit("Hz"),
        Entry::ro(6, "MCAN0 clock hz", U32).default(80_000_000).unit("Hz"),
        Entry::ro(7, "MCAN1 clock hz", U32).default(80_000_000).unit("Hz"),
        Entry::ro(8, "MCAN2 clock hz", U32).default(80_000_000).unit("Hz"),
        Entry::ro(9, "MCAN3 clock hz", U32).default(80_000_000).unit("Hz"),
        Entry::rw(CONFIG_VERSION, "Config version", U32).default(0).key("config_version"),
        Entry::ro(11, "Last apply result", U32).default(0),
        Entry::rw(DeviceConfig::ROTATION.1, "CAN pin rotation", U8)
            .default(0)
            .range(0, 3)
            .key("pin_rotation")
            .result(ROTATION_STATUS),
        Entry::ro(DeviceConfig::ACTIVE_ROTATION.1, "Active CAN pin rotation", U8)
            .default(0)
            .range(0, 3),
        Entry::ro(ROTATION_MASK, "CAN pin rotation mask", U8).default(0x0F).bits(&[
            (0, "rotation 0"),
            (1, "rotation 1"),
            (2, "rotation 2"),
            (3, "rotation 3"),
        ]),
        Entry::ro(ROTATION_STATUS, "CAN pin apply status", U8).default(0),
    ],
)
.saved();

const MODE: &[(u32, &str)] = &[(0, "run"), (1, "engineering"), (2, "factory")];

pub(super) const MAINTENANCE: Object = Object::single(
    MAINTENANCE_INDEX,
    "Device Maintenance",
    "13.7",
    &[
        Entry::highest(12),
        Entry::rw(1, "Access mode request", U8).range(0, 2).values(MODE),
        Entry::ro(2, "Access status", U8).values(MODE),
        Entry::rw(ACCESS_TIMEOUT, "Access timeout s", U16).unit("s").key("access_timeout_s"),
        Entry::wo(4, "Maintenance command", U8).result_after(5, 12).range(0, 0x7F).bits(&[
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

/// Configuration of the objects that belong to no channel and no direction: 0x8000, 0x8020, 0x8030 and 0xB000
/// (manual 13.2.1, 13.2.3, 13.3, 13.7).
///
/// What is `None` is not written: the gateway keeps its own value.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct DeviceConfig {
    /// Rotation of the channels over the connectors, 0 to 3 (0x8000:12). Written before the channels and
    /// verified after them, because the manual does not state when it takes effect (assumption H47).
    pub pin_rotation: Option<u8>,
    /// CPU voltage in mV that the gateway echoes (0x8000:03); the write changes no voltage.
    pub cpu_voltage_mv: Option<u16>,
    /// Version of the master's configuration, which the gateway echoes (0x8000:10).
    pub config_version: Option<u32>,
    /// Time limit of engineering and factory mode in seconds (0xB000:03).
    pub access_timeout_s: Option<u16>,
    /// Data path of the whole gateway (0x8020).
    pub data_path: Option<DataPathGlobal>,
    /// Diagnostic test (0x8030). `None` expects that no test is active, unless tests are allowed;
    /// [`DiagnosticTest::OFF`] ends an active one.
    pub diagnostic_test: Option<DiagnosticTest>,
}

/// A fault of a [`DeviceConfig`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum DeviceFault {
    /// A field outside the range of its entry.
    #[error("{0}")]
    Range(RangeFault),
    /// The data path of the gateway.
    #[error("{0}")]
    DataPath(DataPathFault),
    /// The diagnostic test.
    #[error("{0}")]
    Test(DiagnosticFault),
}

impl DeviceConfig {
    /// The objects, each with the name of its table in a configuration file.
    pub const OBJECTS: [(u16, &'static str); 4] = [
        (SYSTEM_INDEX, "system"),
        (DataPathGlobal::INDEX, "data_path"),
        (DiagnosticTest::INDEX, "diagnostic_test"),
        (MAINTENANCE_INDEX, "maintenance"),
    ];

    /// Index and subindex of the requested pin rotation.
    pub const ROTATION: (u16, u8) = (SYSTEM_INDEX, 12);
    /// Index and subindex of the active pin rotation.
    pub const ACTIVE_ROTATION: (u16, u8) = (SYSTEM_INDEX, 13);

    /// Entries that are fields of this struct, in the order in which they are written.
    const SINGLE: [(&'static Object, u8); 4] = [
        (&SYSTEM, Self::ROTATION.1),
        (&SYSTEM, CPU_VOLTAGE),
        (&SYSTEM, CONFIG_VERSION),
        (&MAINTENANCE, ACCESS_TIMEOUT),
    ];

    /// Raw value of an entry; `None` if it is not configured, or belongs to another object.
    pub fn value(&self, index: u16, subindex: u8) -> Option<u32> {
        match (index, subindex) {
            Self::ROTATION => self.pin_rotation.map(Into::into),
            (SYSTEM_INDEX, CPU_VOLTAGE) => self.cpu_voltage_mv.map(Into::into),
            (SYSTEM_INDEX, CONFIG_VERSION) => self.config_version,
            (MAINTENANCE_INDEX, ACCESS_TIMEOUT) => self.access_timeout_s.map(Into::into),
            (DataPathGlobal::INDEX, _) => self.data_path?.value(subindex),
            (DiagnosticTest::INDEX, _) => self.diagnostic_test?.value(subindex),
            _ => None,
        }
    }

    /// Configures 0x8020 or 0x8030 with the device's defaults, unless it is configured. Has no effect on objects
    /// whose entries are written one by one.
    pub fn enable(&mut self, index: u16) {
        match index {
            DataPathGlobal::INDEX => _ = self.data_path.get_or_insert_default(),
            DiagnosticTest::INDEX => _ = self.diagnostic_test.get_or_insert_default(),
            _ => {}
        }
    }

    /// Configures an entry. The other entries of 0x8020 and 0x8030 have the device's default if they
    /// were not configured. Ranges are not checked.
    ///
    /// # Errors
    /// [`InvalidValue`] if the entry is not among the configured ones, or its type has no such value.
    pub fn set_value(&mut self, index: u16, subindex: u8, value: u32) -> Result<(), InvalidValue> {
        let invalid = InvalidValue { index, subindex, value };
        match (index, subindex) {
            Self::ROTATION => {
                self.pin_rotation = Some(value.try_into().map_err(|_| invalid)?);
            }
            (SYSTEM_INDEX, CPU_VOLTAGE) => {
                self.cpu_voltage_mv = Some(value.try_into().map_err(|_| invalid)?);
            }
            (SYSTEM_INDEX, CONFIG_VERSION) => self.config_version = Some(value),
            (MAINTENANCE_INDEX, ACCESS_TIMEOUT) => {
                self.access_timeout_s = Some(value.try_into().map_err(|_| invalid)?);
            }
            (DataPathGlobal::INDEX, _) => set_field(&mut self.data_path, subindex, value)?,
            (DiagnosticTest::INDEX, _) => set_field(&mut self.diagnostic_test, subindex, value)?,
            _ => return Err(invalid),
        }
        Ok(())
    }

    /// The downloads that come before the channels: the rotation first, because it may restart them.
    pub fn first_writes(&self) -> impl Iterator<Item = SdoWrite> + use<> {
        let config = *self;
        Self::SINGLE.into_iter().filter_map(move |(object, subindex)| {
            let (index, entry) = (object.first, object.entry(subindex)?);
            Some(SdoWrite::new(index, subindex, entry.ty, config.value(index, subindex)?))
        })
    }

    /// The downloads of 0x8020, without its apply command.
    pub fn data_path_writes(&self) -> impl Iterator<Item = SdoWrite> + use<> {
        self.data_path.into_iter().flat_map(|global| global.writes())
    }

    /// The downloads of 0x8030, which come last.
    pub fn test_writes(&self) -> impl Iterator<Item = SdoWrite> + use<> {
        self.diagnostic_test.into_iter().flat_map(|test| test.writes())
    }

    /// What the gateway reports when the configuration is active: index, subindex and value of active
    /// rotation, its status, and the apply status of 0x8020.
    pub fn readbacks(&self) -> impl Iterator<Item = (u16, u8, u32)> + use<> {
        let rotation = self.pin_rotation.map(|rotation| {
            let (index, subindex) = Self::ACTIVE_ROTATION;
            [(SYSTEM_INDEX, ROTATION_STATUS, 0), (index, subindex, rotation.into())]
        });
        let data_path = self.data_path.map(|_| (DataPathGlobal::INDEX, 3, 0));
        rotation.into_iter().flatten().chain(data_path)
    }

    /// The entry with the supported rotations, and the bit that the configured one needs (0x8000:14).
    pub fn needed_rotation(&self) -> Option<(u16, u8, u32)> {
        let bit = 1_u32.checked_shl(self.pin_rotation?.into()).unwrap_or(0);
        Some((SYSTEM_INDEX, ROTATION_MASK, bit))
    }

    /// Reports every fault.
    pub fn check(&self, report: &mut dyn FnMut(DeviceFault)) {
        for (object, subindex) in Self::SINGLE {
            let index = object.first;
            if let (Some(value), Some(entry)) =
                (self.value(index, subindex), object.entry(subindex))
                && !(entry.min..=entry.max).contains(&value)
            {
                let (min, max) = (entry.min, entry.max);
                report(DeviceFault::Range(RangeFault { index, subindex, value, min, max }));
            }
        }
        if let Some(global) = &self.data_path {
            global.check(&mut |fault| report(DeviceFault::DataPath(fault)));
        }
        if let Some(test) = &self.diagnostic_test {
            test.check(&mut |fault| report(DeviceFault::Test(fault)));
        }
    }
}

/// Sets a field of an object; without an error the object is configured then.
fn set_field<C: ConfigObject>(
    object: &mut Option<C>,
    subindex: u8,
    value: u32,
) -> Result<(), InvalidValue> {
    let mut config = object.unwrap_or_default();
    config.set_value(subindex, value)?;
    *object = Some(config);
    Ok(())
}
