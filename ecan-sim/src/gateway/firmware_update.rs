//! Two application partitions and the update that writes the free one (manual 13.7, 15.3.1).
//!
//! A file arrives in parts. The free partition is erased first, then written sector by sector,
//! which takes time: during that time parts are answered with "busy" and must be repeated. The file
//! is checked after its last part; a valid one is marked for the next start, and the gateway
//! restarts a little later. An interruption keeps the running version. The times, the size of a
//! partition and the FoE error numbers are assumptions.

use thiserror::Error;

use super::NS_PER_MS;
use super::crc32::crc32;
use super::fault::PendingFaults;
use super::firmware_package::{FirmwarePackage, FirmwarePackageError, Header};

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
