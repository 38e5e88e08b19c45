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

const HEADER_BYTES: usize = FirmwarePackage::HEADER_BYTES;
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
    /// Device type, 0xF000:01; 0 for ECAN-Lite.
    pub device_type: u8,
    /// Version: 0xF000:05 in the upper half, :06 in the lower one.
    pub version: u32,
    /// The application.
    pub payload: Vec<u8>,
}

/// Fault of a firmware package.
#[derive(Clone, Copy, Debug, Error, PartialEq, Eq)]
pub enum FirmwarePackageError {
    /// Shorter than the header: the length of the file, in bytes.
    #[error("{0} bytes are too short for a package header; needed: {HEADER_BYTES} bytes")]
    NoHeader(usize),
    /// The first bytes are not those of a package, for example of a bare application.
    #[error("the file is not in packaging format: it does not begin with ECLA")]
    NotAPackage,
    /// The CRC of the header, and the computed one.
    #[error("header CRC32 {0:#010x} is wrong; computed: {1:#010x}")]
    HeaderCheck(u32, u32),
    /// Offset and value of a field of an otherwise valid header that has an undefined value.
    #[error("invalid value {1:#010x} in the header field at offset {0}")]
    HeaderField(u8, u32),
    /// Length of the payload by the header, and in the file.
    #[error("the payload has {1} bytes; the header gives {0}")]
    Length(u32, usize),
    /// The CRC of the payload in the header, and the computed one.
    #[error("payload CRC32 {0:#010x} is wrong; computed: {1:#010x}")]
    PayloadCheck(u32, u32),
}

impl FirmwarePackage {
    /// Bytes before the payload.
    pub const HEADER_BYTES: usize = 32;

    /// A package with these fields.
    #[must_use]
    pub fn new(device_type: u8, version: u32, payload: Vec<u8>) -> Self {
        Self { device_type, version, payload }
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
        let error = FirmwarePackageError::NoHeader(file.len());
        let (header, _) =
            file.split_first_chunk::<{ FirmwarePackage::HEADER_BYTES }>().ok_or(error)?;
        let (words, _) = header.as_chunks::<4>();
        let words: [[u8; 4]; 8] = words.try_into().map_err(|_| error)?;
        let [magic, length, device, version, payload_bytes, payload_crc, reserved, found] =
            words.map(u32::from_le_bytes);
        if magic != u32::from_le_bytes(MAGIC) {
            return Err(FirmwarePackageError::NotAPackage);
        }
        let computed = crc32(header.split_last_chunk::<4>().map_or(&[], |(checked, _)| checked));
        if found != computed {
            return Err(FirmwarePackageError::HeaderCheck(found, computed));
        }
        let fault = |offset, value| Err(FirmwarePackageError::HeaderField(offset, value));
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
            return Err(FirmwarePackageError::Length(self.payload_bytes, payload.len()));
        }
        let computed = crc32(payload);
        if computed != self.payload_crc {
            return Err(FirmwarePackageError::PayloadCheck(self.payload_crc, computed));
        }
        Ok(payload)
    }
}
