//! Capabilities of a gateway from 0xF000 (manual 13.8).

use crate::mapping::{CHUNK_BYTES, HEADER_BYTES};

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
