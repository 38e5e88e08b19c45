//! Two application partitions, the update that writes the free one (manual 13.7, 15.3.1), and the file format of
//! the firmware.
//!
//! A file arrives in parts. The free partition is erased first, then written sector by sector,
//! which takes time: during that time parts are answered with "busy" and must be repeated. The file
//! is checked after its last part; a valid one is marked for the next start, and the gateway
//! restarts a little later. An interruption keeps the running version. The times, the size of a
//! partition and the FoE error numbers are assumptions.
//!
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
//!
//! CRC32 of stored configurations and firmware. The manual specifies no polynomial; this is the one
//! of Ethernet frames (reflected 0x04C11DB7).

use crc::{CRC_32_ISO_HDLC, Crc};
use thiserror::Error;

use super::NS_PER_MS;
use super::fault::PendingFaults;

/// Bytes of an application partition, package header included.
const PARTITION_BYTES: usize = 512 * 1024;
const SECTOR_BYTES: usize = 4096;
const ERASE_NS: u64 = 100 * NS_PER_MS;
const SECTOR_WRITE_NS: u64 = 2 * NS_PER_MS;
/// From the last response of an update, or an activation, to the restart.
const RESET_DELAY_NS: u64 = 500 * NS_PER_MS;
/// Product and device type of this gateway.
const DEVICE_TYPE: u8 = 0;
const FACTORY_PAYLOAD: &[u8] = b"ECAN-Lite application, simulated";

/// 0xB000:11, in addition to FoE error codes; the manual gives no numbers.
const STATUS_NONE: u32 = 0;
const STATUS_RECEIVING: u32 = 1;
const STATUS_VERIFIED: u32 = 2;

/// Cause of a rejected or failed firmware update.
#[derive(Clone, Copy, Debug, Error, PartialEq, Eq)]
pub enum FirmwareUpdateError {
    /// The gateway has no supply, boots, or will restart with another version.
    #[error("the gateway cannot receive firmware now; retry when it is running")]
    NotReady,
    /// A part without an update in progress.
    #[error("no firmware update is in progress")]
    NotBegun,
    /// The file is larger than a partition.
    #[error("the file is larger than a partition; allowed: {PARTITION_BYTES} bytes")]
    TooBig,
    /// The flash could not be erased or written.
    #[error("the flash could not be erased or written")]
    Flash,
    /// The file is not a valid package.
    #[error("the file is not a valid package: {0}")]
    Package(#[from] FirmwarePackageError),
    /// The package is for another product, of this device type.
    #[error("the package is for device type {0}, this gateway is of type {DEVICE_TYPE}")]
    WrongDevice(u8),
}

impl FirmwareUpdateError {
    /// The FoE error code (ETG.1000.6), also in 0xB000:11.
    #[must_use]
    pub fn foe_code(self) -> u32 {
        match self {
            Self::NotReady => 0x8002,
            Self::NotBegun => 0x8004,
            Self::TooBig => 0x8003,
            Self::Flash => 0x8011,
            Self::Package(FirmwarePackageError::PayloadCheck(..)) => 0x800C,
            Self::Package(_) => 0x8010,
            Self::WrongDevice(_) => 0x800D,
        }
    }

    /// Text of the FoE error (manual 15.3.1).
    #[must_use]
    pub fn foe_text(self) -> &'static str {
        match self {
            Self::NotReady => "Access denied",
            Self::NotBegun => "Illegal operation",
            Self::TooBig | Self::Flash => "file write fail",
            Self::Package(_) | Self::WrongDevice(_) => "OTA verify failed",
        }
    }
}

/// Progress of an update after a part or after its end.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FirmwareProgress {
    /// The part was accepted; after the end: the file is valid, and the gateway restarts soon.
    Done,
    /// The flash is busy; repeat the call later.
    Busy {
        /// Progress of the flash operation, in percent.
        percent: u8,
    },
}

#[derive(Clone, Debug)]
struct Transfer {
    busy_since: u64,
    ready_at: u64,
    sector: Vec<u8>,
}

impl Transfer {
    fn progress(&self, now: u64) -> FirmwareProgress {
        let (past, whole) = (now - self.busy_since, self.ready_at - self.busy_since);
        let percent = (past * 100).checked_div(whole).unwrap_or(0);
        FirmwareProgress::Busy { percent: u8::try_from(percent).unwrap_or(100) }
    }

    fn occupy(&mut self, now: u64, duration: u64) {
        self.busy_since = now;
        self.ready_at = now + duration;
    }
}

#[derive(Clone, Debug)]
pub(super) struct FirmwareUpdate {
    // survives power loss
    pub(super) running_file: Vec<u8>,
    /// The written part of the file in the free partition.
    free_file: Vec<u8>,
    /// The free partition is marked for the next start.
    starts_free: bool,
    /// Size and CRC32 of the last file that was complete, good or bad.
    last_image: (u32, u32),
    // of the present start
    pub(super) header: Header,
    transfer: Option<Transfer>,
    status: u32,
    /// Time of the restart with the marked partition.
    pub(super) reset_at: Option<u64>,
}

fn check(file: &[u8]) -> Result<Header, FirmwareUpdateError> {
    let header = Header::parse(file)?;
    if header.device_type != DEVICE_TYPE {
        return Err(FirmwareUpdateError::WrongDevice(header.device_type));
    }
    header.check_payload(file)?;
    Ok(header)
}

impl FirmwareUpdate {
    pub(super) fn new((major, minor): (u16, u16)) -> Self {
        let version = u32::from(major) << 16 | u32::from(minor);
        let package = FirmwarePackage::new(DEVICE_TYPE, version, FACTORY_PAYLOAD.to_vec());
        Self {
            header: package.header(),
            running_file: package.to_bytes(),
            free_file: Vec::new(),
            starts_free: false,
            last_image: (0, 0),
            transfer: None,
            status: STATUS_NONE,
            reset_at: None,
        }
    }

    pub(super) fn stop(&mut self) {
        self.transfer = None;
        self.reset_at = None;
        self.status = STATUS_NONE;
    }

    /// A start: the marked partition runs.
    pub(super) fn start(&mut self) {
        if std::mem::take(&mut self.starts_free)
            && let Ok(header) = check(&self.free_file)
        {
            self.header = header;
            std::mem::swap(&mut self.running_file, &mut self.free_file);
        }
    }

    /// 0xF000:05 and :06 of the running version.
    pub(super) fn version(&self) -> (u16, u16) {
        ((self.header.version >> 16) as u16, self.header.version as u16)
    }

    /// Value of a subindex of 0xB000; `None` for the others.
    pub(super) fn readback(&self, subindex: u8) -> Option<u32> {
        Some(match subindex {
            9 => self.last_image.0,
            10 => self.last_image.1,
            11 => self.status,
            _ => return None,
        })
    }

    pub(super) fn abandon(&mut self) {
        if self.transfer.take().is_some() {
            self.status = STATUS_NONE;
        }
    }

    fn fail(&mut self, error: FirmwareUpdateError) -> FirmwareUpdateError {
        self.transfer = None;
        self.status = error.foe_code();
        error
    }

    pub(super) fn begin(
        &mut self,
        now: u64,
        faults: &mut PendingFaults,
    ) -> Result<(), FirmwareUpdateError> {
        if self.reset_at.is_some() {
            return Err(FirmwareUpdateError::NotReady);
        }
        self.transfer = None;
        self.starts_free = false;
        self.free_file.clear();
        if faults.flash_failures.take() {
            return Err(self.fail(FirmwareUpdateError::Flash));
        }
        let sector = Vec::with_capacity(SECTOR_BYTES);
        self.transfer = Some(Transfer { busy_since: now, ready_at: now + ERASE_NS, sector });
        self.status = STATUS_RECEIVING;
        Ok(())
    }

    pub(super) fn write(
        &mut self,
        now: u64,
        data: &[u8],
        faults: &mut PendingFaults,
    ) -> Result<FirmwareProgress, FirmwareUpdateError> {
        let transfer = self.transfer.as_mut().ok_or(FirmwareUpdateError::NotBegun)?;
        if now < transfer.ready_at {
            return Ok(transfer.progress(now));
        }
        if self.free_file.len() + transfer.sector.len() + data.len() > PARTITION_BYTES {
            return Err(self.fail(FirmwareUpdateError::TooBig));
        }
        transfer.sector.extend_from_slice(data);
        let sectors = transfer.sector.len() / SECTOR_BYTES;
        if sectors > 0 {
            if faults.flash_failures.take() {
                return Err(self.fail(FirmwareUpdateError::Flash));
            }
            self.free_file.extend(transfer.sector.drain(..sectors * SECTOR_BYTES));
            transfer.occupy(now, sectors as u64 * SECTOR_WRITE_NS);
        }
        Ok(FirmwareProgress::Done)
    }

    /// Writes the last sector, then checks and marks the file.
    pub(super) fn finish(
        &mut self,
        now: u64,
        faults: &mut PendingFaults,
    ) -> Result<FirmwareProgress, FirmwareUpdateError> {
        let transfer = self.transfer.as_mut().ok_or(FirmwareUpdateError::NotBegun)?;
        if now < transfer.ready_at {
            return Ok(transfer.progress(now));
        }
        if !transfer.sector.is_empty() {
            if faults.flash_failures.take() {
                return Err(self.fail(FirmwareUpdateError::Flash));
            }
            self.free_file.append(&mut transfer.sector);
            transfer.occupy(now, SECTOR_WRITE_NS);
            return Ok(transfer.progress(now));
        }
        self.last_image = (self.free_file.len() as u32, crc32(&self.free_file));
        self.activate(now).map_err(|error| self.fail(error))?;
        self.transfer = None;
        Ok(FirmwareProgress::Done)
    }

    pub(super) fn validate(&self) -> Result<(), FirmwareUpdateError> {
        check(&self.free_file).map(|_| ())
    }

    /// Checks the file in the free partition and restarts with it soon.
    pub(super) fn activate(&mut self, now: u64) -> Result<(), FirmwareUpdateError> {
        self.validate()?;
        self.starts_free = true;
        self.status = STATUS_VERIFIED;
        self.reset_at = Some(now + RESET_DELAY_NS);
        Ok(())
    }

    /// Returns whether a file is being received; nothing else may change the flash then.
    pub(super) fn is_receiving(&self) -> bool {
        self.transfer.is_some()
    }
}

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

static CRC: Crc<u32> = Crc::<u32>::new(&CRC_32_ISO_HDLC);

pub(super) fn crc32(bytes: &[u8]) -> u32 {
    CRC.checksum(bytes)
}
