//! Packaged firmware file of an update (manual 13.8, 15.3.1).
//!
//! The manual specifies the contents of the header but not its layout: this layout is the
//! simulator's own, and files of real devices differ. 32 bytes, little endian, followed by the
//! payload:
//!
//! | offset | field |
//! | --- | --- |
//! | 0 | the letters `ECLA` |
//! | 4 | length of the header, 32 |
//! | 8 | device, its type in bits 24..31, the others 0 |
//! | 12 | version, 0xF000:05 in the upper and 0xF000:06 in the lower half |
//! | 16 | length of the payload |
//! | 20 | CRC32 of the payload |
//! | 24 | reserved, 0 |
//! | 28 | CRC32 of the 28 bytes before |
//!
//! Both are CRC-32 as in Ethernet frames (reflected 0x04C11DB7).

use thiserror::Error;

use super::crc32::crc32;

const MAGIC: [u8; 4] = *b"ECLA";
const DEVICE_TYPE_SHIFT: u32 = 24;

/// A packaged firmware: header data and payload.
///
/// ```
/// use ecan_sim::FirmwarePackage;
/// let package = FirmwarePackage::new(0, 0x0203_0007, vec![0xA5; 1000]);
/// let file = package.to_bytes();
/// assert_eq!(file.len(), FirmwarePackage::HEADER_BYTES + 1000);
/// assert_eq!(FirmwarePackage::parse(&file), Ok(package));
/// ```
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FirmwarePackage {
    device_type: u8,
    version: u32,
    payload: Vec<u8>,
}

/// Fault of a firmware package.
#[derive(Clone, Copy, Debug, Error, PartialEq, Eq)]
pub enum FirmwarePackageError {
    /// Shorter than the header.
    #[error(
        "{bytes} bytes are too short for a package header; needed: {} bytes",
        FirmwarePackage::HEADER_BYTES
    )]
    NoHeader {
        /// Length of the file.
        bytes: usize,
    },
    /// The first bytes are not those of a package, for example of a bare application.
    #[error("the file is not in packaging format: it does not begin with ECLA")]
    NotAPackage,
    /// The CRC of the header is wrong.
    #[error("header CRC32 {found:#010x} is wrong; computed: {computed:#010x}")]
    HeaderCheck {
        /// CRC32 in the file.
        found: u32,
        /// Computed CRC32.
        computed: u32,
    },
    /// A field of an otherwise valid header has an undefined value.
    #[error("invalid value {value:#010x} in the header field at offset {offset}")]
    HeaderField {
        /// Offset of the field.
        offset: u8,
        /// Its value.
        value: u32,
    },
    /// The file does not have the length given in the header.
    #[error("the payload has {found} bytes; the header gives {announced}")]
    Length {
        /// Payload length in the header.
        announced: u32,
        /// Bytes of payload in the file.
        found: usize,
    },
    /// The CRC of the payload is wrong.
    #[error("payload CRC32 {found:#010x} is wrong; computed: {computed:#010x}")]
    PayloadCheck {
        /// CRC32 in the file.
        found: u32,
        /// Computed CRC32.
        computed: u32,
    },
}

impl FirmwarePackage {
    /// Bytes before the payload.
    pub const HEADER_BYTES: usize = 32;

    /// A package of a device type (0xF000:01, 0 for ECAN-Lite), a version (0xF000:05 in the upper
    /// half, :06 in the lower one) and the application itself.
    #[must_use]
    pub fn new(device_type: u8, version: u32, payload: Vec<u8>) -> Self {
        Self { device_type, version, payload }
    }

    /// Device type of 0xF000:01.
    #[must_use]
    pub fn device_type(&self) -> u8 {
        self.device_type
    }

    /// Version: major in the upper half, minor in the lower one.
    #[must_use]
    pub fn version(&self) -> u32 {
        self.version
    }

    /// The application.
    #[must_use]
    pub fn payload(&self) -> &[u8] {
        &self.payload
    }

    pub(super) fn header(&self) -> Header {
        Header {
            device_type: self.device_type,
            version: self.version,
            payload_bytes: u32::try_from(self.payload.len()).unwrap_or(u32::MAX),
            payload_crc: crc32(&self.payload),
        }
    }

    /// The file.
    #[must_use]
    pub fn to_bytes(&self) -> Vec<u8> {
        let mut file = Vec::with_capacity(Self::HEADER_BYTES + self.payload.len());
        file.extend_from_slice(&MAGIC);
        let header = self.header();
        let words = [
            Self::HEADER_BYTES as u32,
            u32::from(header.device_type) << DEVICE_TYPE_SHIFT,
            header.version,
            header.payload_bytes,
            header.payload_crc,
            0,
        ];
        for word in words {
            file.extend_from_slice(&word.to_le_bytes());
        }
        let check = crc32(&file);
        file.extend_from_slice(&check.to_le_bytes());
        file.extend_from_slice(&self.payload);
        file
    }

    /// Parses a file.
    ///
    /// # Errors
    /// The first fault, header before payload.
    pub fn parse(file: &[u8]) -> Result<Self, FirmwarePackageError> {
        let header = Header::parse(file)?;
        let payload = header.check_payload(file)?;
        Ok(Self::new(header.device_type, header.version, payload.to_vec()))
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Header {
    pub(super) device_type: u8,
    pub(super) version: u32,
    payload_bytes: u32,
    payload_crc: u32,
}

impl Header {
    pub(super) fn parse(file: &[u8]) -> Result<Self, FirmwarePackageError> {
        let bytes = file.len();
        let (header, _) = file
            .split_first_chunk::<{ FirmwarePackage::HEADER_BYTES }>()
            .ok_or(FirmwarePackageError::NoHeader { bytes })?;
        let (words, _) = header.as_chunks::<4>();
        let &[magic, length, device, version, payload_bytes, payload_crc, reserved, check] = words
        else {
            return Err(FirmwarePackageError::NoHeader { bytes });
        };
        if magic != MAGIC {
            return Err(FirmwarePackageError::NotAPackage);
        }
        let [length, device, version, payload_bytes, payload_crc, reserved, found] =
            [length, device, version, payload_bytes, payload_crc, reserved, check]
                .map(u32::from_le_bytes);
        let computed = crc32(header.split_last_chunk::<4>().map_or(&[], |(checked, _)| checked));
        if found != computed {
            return Err(FirmwarePackageError::HeaderCheck { found, computed });
        }
        let fault = |offset, value| Err(FirmwarePackageError::HeaderField { offset, value });
        if length != FirmwarePackage::HEADER_BYTES as u32 {
            return fault(4, length);
        }
        let [0, 0, 0, device_type] = device.to_le_bytes() else {
            return fault(8, device);
        };
        if reserved != 0 {
            return fault(24, reserved);
        }
        Ok(Self { device_type, version, payload_bytes, payload_crc })
    }

    pub(super) fn check_payload<'a>(
        &self,
        file: &'a [u8],
    ) -> Result<&'a [u8], FirmwarePackageError> {
        let payload = file.get(FirmwarePackage::HEADER_BYTES..).unwrap_or_default();
        if u32::try_from(payload.len()) != Ok(self.payload_bytes) {
            let (announced, found) = (self.payload_bytes, payload.len());
            return Err(FirmwarePackageError::Length { announced, found });
        }
        let computed = crc32(payload);
        if computed != self.payload_crc {
            return Err(FirmwarePackageError::PayloadCheck { found: self.payload_crc, computed });
        }
        Ok(payload)
    }
}
