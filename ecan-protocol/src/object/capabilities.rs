//! 0xF000 Device Objects: identity, capabilities and limits (manual 13.8), and the entries that a firmware
//! may lack.

use super::ObjectType::{U8, U16, U32};
use super::diagnostic_test::TESTS;
use super::entry::{Entry, Object};
use super::pdo_profile::OptionFlags;
use super::value::ObjectValue;
use crate::mapping::{CHUNK_BYTES, HEADER_BYTES};

pub(super) const DEVICE_OBJECTS: Object = Object::single(
    0xF000,
    "Device Objects",
    "13.8",
    &[
        Entry::highest(32),
        Entry::ro(1, "Device type", U8),
        Entry::ro(2, "Channel count", U8).default(4),
        Entry::ro(3, "Capability version", U16).default(1),
        Entry::ro(4, "Hardware revision", U32),
        Entry::ro(5, "Firmware version major", U16),
        Entry::ro(6, "Firmware version minor", U16),
        Entry::ro(7, "Serial number low", U32),
        Entry::ro(8, "Serial number high", U32),
        Entry::ro(9, "PDO header version mask", U16)
            .default(0x0002)
            .bits(&[(1, "header version 1")]),
        Entry::ro(10, "PDO size multiplier min", U8).default(1),
        Entry::ro(11, "PDO size multiplier max", U8).default(24),
        Entry::ro(12, "Encapsulation profile mask", U32).default(0x33).bits(&[
            (0, "profile 0: variable DLC, no timestamp"),
            (1, "profile 1: variable DLC, delta16 allowed"),
            (4, "profile 4: D64 allowed, no timestamp"),
            (5, "profile 5: D64 allowed, delta16 allowed"),
        ]),
        Entry::ro(13, "Max PDO bytes", U16).default(3072).unit("bytes"),
        Entry::ro(14, "Max CAN channels", U8).default(4),
        Entry::ro(15, "PDO option flags mask", U8).default(0x1F).bits(OptionFlags::BITS),
        Entry::ro(16, "PDO feature flags", U32).default(0x1F3B).bits(&[
            (0, "TX_RESULT"),
            (1, "TSF_DELTA16"),
            (2, "TSF_DELTA32"),
            (3, "TSF_FULL64"),
            (4, "D64"),
            (5, "ALIGN4"),
            (6, "STREAM_CRC32"),
            (8, "RX_TSF_SCHEDULE_TX"),
            (9, "NO_CRC16"),
            (10, "APP_BYPASS"),
            (11, "PAYLOAD_ONLY"),
            (12, "FINE_BYPASS"),
        ]),
        Entry::ro(17, "PDO size unit bytes", U16).default(128).unit("bytes"),
        Entry::ro(18, "PDO fixed header bytes", U16).default(24).unit("bytes"),
        Entry::ro(19, "Device service flags", U32).default(0x15).bits(&[
            (0, "FoE firmware update"),
            (2, "configuration persistence"),
            (4, "access levels"),
        ]),
        Entry::ro(20, "Object extension set", U16).default(1),
        Entry::ro(21, "Data path extension set", U16).default(1),
        Entry::ro(22, "Diagnostic extension set", U16).default(1),
        Entry::ro(23, "Reserved capability pad", U16).default(0),
        Entry::ro(24, "Data path feature flags", U32).default(0x1F).bits(TESTS),
        Entry::ro(25, "Diagnostic feature flags", U32).default(0x1F).bits(TESTS),
        Entry::ro(26, "Runtime option flags mask", U32).default(0),
        Entry::ro(27, "Diagnostic option flags mask", U32).default(0),
        Entry::ro(28, "MCAN RX cache max depth", U16).default(32).unit("frames"),
        Entry::ro(29, "MCAN TX cache max depth", U16).default(64).unit("frames"),
        Entry::ro(30, "Max service budget us", U16).default(1000).unit("us"),
        Entry::ro(31, "Reserved capability0", U16).default(0),
        Entry::ro(32, "Reserved capability1", U32).default(0),
    ],
);

const INDEX: u16 = 0xF000;

/// PDO feature flags, 0xF000:16.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct FeatureFlags(pub u32);

impl FeatureFlags {
    /// TX_RESULT packets.
    pub const TX_RESULT: Self = Self(1 << 0);
    /// 16 bit delta timestamps.
    pub const TSF_DELTA16: Self = Self(1 << 1);
    /// 32 bit delta timestamps.
    pub const TSF_DELTA32: Self = Self(1 << 2);
    /// 64 bit timestamp field.
    pub const TSF_FULL64: Self = Self(1 << 3);
    /// Fixed data windows of 64 bytes.
    pub const D64: Self = Self(1 << 4);
    /// Packets aligned to 4 bytes.
    pub const ALIGN4: Self = Self(1 << 5);
    /// CRC32 of the whole stream.
    pub const STREAM_CRC32: Self = Self(1 << 6);
    /// Scheduled transmission.
    pub const SCHEDULED_TX: Self = Self(1 << 8);
    /// Images without CRC16.
    pub const NO_CRC16: Self = Self(1 << 9);
    /// Bypass of the CAN side.
    pub const APP_BYPASS: Self = Self(1 << 10);
    /// Updates of header and payload only.
    pub const PAYLOAD_ONLY: Self = Self(1 << 11);
    /// Bypass of single stages by 0x8030.
    pub const FINE_BYPASS: Self = Self(1 << 12);

    /// True if all flags of `other` are set.
    pub const fn contains(self, other: Self) -> bool {
        self.0 & other.0 == other.0
    }
}

/// The capability object of a gateway.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Capabilities {
    /// :01 0 is ECAN-Lite, others are customised.
    pub device_type: u8,
    /// :02 CAN channels.
    pub channel_count: u8,
    /// :03 Version of the object.
    pub capability_version: u16,
    /// :04 Hardware revision, 0 if not programmed.
    pub hardware_revision: u32,
    /// :05 Firmware version: high byte major, low byte minor.
    pub firmware_major: u16,
    /// :06 Firmware build.
    pub firmware_minor: u16,
    /// :07, :08 Serial number, 0 if not programmed.
    pub serial_number: u64,
    /// :09 Bit n for header version n.
    pub header_version_mask: u16,
    /// :10 Smallest N.
    pub multiplier_min: u8,
    /// :11 Largest N.
    pub multiplier_max: u8,
    /// :12 Bit n for encapsulation profile n.
    pub profile_mask: u32,
    /// :13 Largest PDO of a direction in bytes.
    pub max_pdo_bytes: u16,
    /// :14 Largest number of channels.
    pub max_channels: u8,
    /// :15 Option flags that can be set.
    pub option_mask: u8,
    /// :16 Features.
    pub features: FeatureFlags,
    /// :17 Bytes per N.
    pub size_unit_bytes: u16,
    /// :18 Bytes of the fixed header.
    pub header_bytes: u16,
    /// :19 Bit 0 FoE, bit 2 persistence, bit 4 access levels.
    pub service_flags: u32,
    /// :20 Version of the object extensions.
    pub object_extension: u16,
    /// :21 Version of the data path extensions.
    pub data_path_extension: u16,
    /// :22 Version of the diagnostic extensions.
    pub diagnostic_extension: u16,
    /// :24 Tests that 0x8030 offers.
    pub data_path_features: u32,
    /// :25 The same.
    pub diagnostic_features: u32,
    /// :26 Runtime options of 0x8020:05.
    pub runtime_option_mask: u32,
    /// :27 Diagnostic options of 0x8020:06.
    pub diagnostic_option_mask: u32,
    /// :28 Receive cache of a channel in frames.
    pub rx_cache_max: u16,
    /// :29 Transmit cache of a channel in frames.
    pub tx_cache_max: u16,
    /// :30 Upper limit of 0x8020:07 in microseconds.
    pub max_service_budget_us: u16,
}

/// The three values that identify an ECAN-Lite.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Recognition {
    /// :09 PDO header version mask.
    pub header_version_mask: u16,
    /// :17 PDO size unit bytes.
    pub size_unit_bytes: u16,
    /// :18 PDO fixed header bytes.
    pub header_bytes: u16,
}

impl Recognition {
    /// The subindices of 0xF000 to read.
    pub const SUBINDICES: [u8; 3] = [9, 17, 18];

    /// Reads the values; `read` gets a subindex of 0xF000.
    ///
    /// # Errors
    /// The first error of `read`.
    pub fn read<E>(mut read: impl FnMut(u8) -> Result<u32, E>) -> Result<Self, E> {
        Ok(Self {
            header_version_mask: read(9)? as u16,
            size_unit_bytes: read(17)? as u16,
            header_bytes: read(18)? as u16,
        })
    }

    /// True if the device has this protocol: header version 1, units of 128 bytes, a fixed header of
    /// 24. Other devices also have an object 0xF000, but not with these values.
    pub const fn looks_like_ecan_lite(&self) -> bool {
        self.header_version_mask & 1 << 1 != 0
            && self.size_unit_bytes as usize == CHUNK_BYTES
            && self.header_bytes as usize == HEADER_BYTES
    }
}

impl Capabilities {
    /// Index of the object.
    pub const INDEX: u16 = INDEX;

    /// Subindices that [`read`](Self::read) reads, in this order.
    pub const fn fields() -> &'static [u8] {
        &[
            1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16, 17, 18, 19, 20, 21, 22, 24, 25,
            26, 27, 28, 29, 30,
        ]
    }

    /// Reads the object; `read` gets each subindex of [`fields`](Self::fields) in turn.
    ///
    /// # Errors
    /// The first error of `read`.
    pub fn read<E>(mut read: impl FnMut(u8) -> Result<u32, E>) -> Result<Self, E> {
        Ok(Self {
            device_type: read(1)? as u8,
            channel_count: read(2)? as u8,
            capability_version: read(3)? as u16,
            hardware_revision: read(4)?,
            firmware_major: read(5)? as u16,
            firmware_minor: read(6)? as u16,
            serial_number: u64::from(read(7)?) | u64::from(read(8)?) << 32,
            header_version_mask: read(9)? as u16,
            multiplier_min: read(10)? as u8,
            multiplier_max: read(11)? as u8,
            profile_mask: read(12)?,
            max_pdo_bytes: read(13)? as u16,
            max_channels: read(14)? as u8,
            option_mask: read(15)? as u8,
            features: FeatureFlags(read(16)?),
            size_unit_bytes: read(17)? as u16,
            header_bytes: read(18)? as u16,
            service_flags: read(19)?,
            object_extension: read(20)? as u16,
            data_path_extension: read(21)? as u16,
            diagnostic_extension: read(22)? as u16,
            data_path_features: read(24)?,
            diagnostic_features: read(25)?,
            runtime_option_mask: read(26)?,
            diagnostic_option_mask: read(27)?,
            rx_cache_max: read(28)? as u16,
            tx_cache_max: read(29)? as u16,
            max_service_budget_us: read(30)? as u16,
        })
    }

    /// The values that identify an ECAN-Lite.
    pub const fn recognition(&self) -> Recognition {
        Recognition {
            header_version_mask: self.header_version_mask,
            size_unit_bytes: self.size_unit_bytes,
            header_bytes: self.header_bytes,
        }
    }

    /// See [`Recognition::looks_like_ecan_lite`].
    pub const fn looks_like_ecan_lite(&self) -> bool {
        self.recognition().looks_like_ecan_lite()
    }

    /// True if frames can be scheduled to a Sync0 phase.
    pub const fn has_scheduled_tx(&self) -> bool {
        self.features.contains(FeatureFlags::SCHEDULED_TX)
    }
}

/// Value that the SDK assumes for an entry that the firmware does not have, or `None` if it needs the entry.
///
/// Of 0xF000 only :17 and :18 are needed: they identify an ECAN-Lite. Limits are those of the manual's table (13.8),
/// because the apply of a profile verifies them; versions, serial number and features are 0, so that an optional
/// feature is not used. Test policies (0x8030) are off.
pub const fn assumed_value(index: u16, subindex: u8) -> Option<u32> {
    match (index, subindex) {
        (0xF000, 17 | 18) => None,
        (0xF000, 2 | 14) => Some(4),
        (0xF000, 9) => Some(1 << 1),
        (0xF000, 10) => Some(1),
        (0xF000, 11) => Some(24),
        (0xF000, 12) => Some(0x33),
        (0xF000, 13) => Some(3072),
        (0xF000, 15) => Some(0x1F),
        (0xF000, 1..=30) | (0x8030, 2..=6) => Some(0),
        _ => None,
    }
}

/// Object, or entry of an object, whose writes a startup can do without: the gateway then keeps its own behaviour.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct OptionalObject {
    /// Index.
    pub index: u16,
    /// Entry; `None` is the whole object.
    pub subindex: Option<u8>,
}

impl OptionalObject {
    /// The optional object that this entry belongs to: timestamp selection and data path of a channel.
    pub const fn of(index: u16, subindex: u8) -> Option<Self> {
        match (index, subindex) {
            (0x8001..=0x8004, 74) => Some(Self { index, subindex: Some(subindex) }),
            (0x8021..=0x8024, _) => Some(Self { index, subindex: None }),
            _ => None,
        }
    }

    /// Entry whose upload shows whether the firmware has the object.
    pub const fn probe(self) -> (u16, u8) {
        match self.subindex {
            Some(subindex) => (self.index, subindex),
            None => (self.index, 1),
        }
    }

    /// Returns whether the entry belongs to it.
    pub const fn contains(self, index: u16, subindex: u8) -> bool {
        match self.subindex {
            Some(own) => self.index == index && own == subindex,
            None => self.index == index,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::device::Capabilities;

    #[test]
    fn identification_alone_is_needed_of_the_capabilities() {
        let needed: [u8; 2] = [17, 18];
        for subindex in Capabilities::fields() {
            let is_needed = assumed_value(Capabilities::INDEX, *subindex).is_none();
            assert_eq!(is_needed, needed.contains(subindex), "{subindex}");
        }
        assert_eq!(assumed_value(0x8030, 4), Some(0));
        assert_eq!(assumed_value(0x8030, 1), None, "the key");
        assert_eq!(assumed_value(0x9020, 12), None);
    }

    #[test]
    fn optional_object_contains_its_entries() {
        let data_path = OptionalObject::of(0x8022, 20).unwrap();
        assert_eq!(data_path.probe(), (0x8022, 1));
        assert!(data_path.contains(0x8022, 3) && !data_path.contains(0x8021, 3));
        let timestamp = OptionalObject::of(0x8001, 74).unwrap();
        assert_eq!(timestamp.probe(), (0x8001, 74));
        assert!(!timestamp.contains(0x8001, 1));
        assert_eq!(OptionalObject::of(0x8001, 1), None);
    }
}
