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
    /// The package is for another product.
    #[error("the package is for device type {found}, this gateway is of type {DEVICE_TYPE}")]
    WrongDevice {
        /// Device type in the package's header.
        found: u8,
    },
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
            Self::Package(FirmwarePackageError::PayloadCheck { .. }) => 0x800C,
            Self::Package(_) => 0x8010,
            Self::WrongDevice { .. } => 0x800D,
        }
    }

    /// Text of the FoE error (manual 15.3.1).
    #[must_use]
    pub fn foe_text(self) -> &'static str {
        match self {
            Self::NotReady => "Access denied",
            Self::NotBegun => "Illegal operation",
            Self::TooBig | Self::Flash => "file write fail",
            Self::Package(_) | Self::WrongDevice { .. } => "OTA verify failed",
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

#[derive(Debug)]
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

#[derive(Debug)]
pub(super) struct FirmwareUpdate {
    // survives power loss
    partitions: [Vec<u8>; 2],
    next_start: usize,
    /// Size and CRC32 of the last file that was complete, good or bad.
    last_image: (u32, u32),
    // of the present start
    running: usize,
    header: Header,
    transfer: Option<Transfer>,
    status: u32,
    reset_at: Option<u64>,
}

fn check(file: &[u8]) -> Result<Header, FirmwareUpdateError> {
    let header = Header::parse(file)?;
    if header.device_type != DEVICE_TYPE {
        return Err(FirmwareUpdateError::WrongDevice { found: header.device_type });
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
            partitions: [package.to_bytes(), Vec::new()],
            next_start: 0,
            last_image: (0, 0),
            running: 0,
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
        let marked = self.partitions.get(self.next_start).map(|file| check(file));
        match marked {
            Some(Ok(header)) => {
                self.header = header;
                self.running = self.next_start;
            }
            _ => self.next_start = self.running,
        }
    }

    pub(super) fn device_type(&self) -> u8 {
        self.header.device_type
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

    pub(super) fn reset_time(&self) -> Option<u64> {
        self.reset_at
    }

    fn free(&self) -> usize {
        1 - self.running
    }

    /// The written part of the file in the free partition.
    fn free_file(&self) -> &[u8] {
        self.partitions.get(self.free()).map_or(&[], Vec::as_slice)
    }

    pub(super) fn running_file(&self) -> &[u8] {
        self.partitions.get(self.running).map_or(&[], Vec::as_slice)
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

    /// `fails`: the flash operation fails.
    pub(super) fn begin(&mut self, now: u64, fails: bool) -> Result<(), FirmwareUpdateError> {
        if self.reset_at.is_some() {
            return Err(FirmwareUpdateError::NotReady);
        }
        self.transfer = None;
        self.next_start = self.running;
        let free = self.free();
        if let Some(partition) = self.partitions.get_mut(free) {
            partition.clear();
        }
        if fails {
            return Err(self.fail(FirmwareUpdateError::Flash));
        }
        let mut transfer =
            Transfer { busy_since: now, ready_at: now, sector: Vec::with_capacity(SECTOR_BYTES) };
        transfer.occupy(now, ERASE_NS);
        self.transfer = Some(transfer);
        self.status = STATUS_RECEIVING;
        Ok(())
    }

    pub(super) fn is_busy(
        &self,
        now: u64,
    ) -> Result<Option<FirmwareProgress>, FirmwareUpdateError> {
        let transfer = self.transfer.as_ref().ok_or(FirmwareUpdateError::NotBegun)?;
        Ok((now < transfer.ready_at).then(|| transfer.progress(now)))
    }

    /// Whether this number of bytes completes a sector, so that a flash operation follows.
    pub(super) fn fills_sector(&self, bytes: usize) -> bool {
        self.transfer.as_ref().is_some_and(|transfer| transfer.sector.len() + bytes >= SECTOR_BYTES)
    }

    /// Whether the end of the file is not written yet.
    pub(super) fn has_rest(&self) -> bool {
        self.transfer.as_ref().is_some_and(|transfer| !transfer.sector.is_empty())
    }

    pub(super) fn write(
        &mut self,
        now: u64,
        data: &[u8],
        fails: bool,
    ) -> Result<(), FirmwareUpdateError> {
        let free = self.free();
        let Self { transfer: Some(transfer), partitions, .. } = self else {
            return Err(FirmwareUpdateError::NotBegun);
        };
        let Some(partition) = partitions.get_mut(free) else {
            return Err(FirmwareUpdateError::NotBegun);
        };
        if partition.len() + transfer.sector.len() + data.len() > PARTITION_BYTES {
            return Err(self.fail(FirmwareUpdateError::TooBig));
        }
        transfer.sector.extend_from_slice(data);
        let whole = transfer.sector.len() / SECTOR_BYTES * SECTOR_BYTES;
        if whole > 0 {
            if fails {
                return Err(self.fail(FirmwareUpdateError::Flash));
            }
            partition.extend(transfer.sector.drain(..whole));
            transfer.occupy(now, (whole / SECTOR_BYTES) as u64 * SECTOR_WRITE_NS);
        }
        Ok(())
    }

    /// Writes the last sector, then checks and marks the file.
    pub(super) fn finish(
        &mut self,
        now: u64,
        fails: bool,
    ) -> Result<FirmwareProgress, FirmwareUpdateError> {
        let free = self.free();
        let Self { transfer: Some(transfer), partitions, .. } = self else {
            return Err(FirmwareUpdateError::NotBegun);
        };
        if !transfer.sector.is_empty() {
            if fails {
                return Err(self.fail(FirmwareUpdateError::Flash));
            }
            if let Some(partition) = partitions.get_mut(free) {
                partition.append(&mut transfer.sector);
            }
            transfer.occupy(now, SECTOR_WRITE_NS);
            return Ok(transfer.progress(now));
        }
        let file = self.free_file();
        self.last_image = (file.len() as u32, crc32(file));
        match self.validate() {
            Ok(()) => {
                self.transfer = None;
                self.mark(now);
                Ok(FirmwareProgress::Done)
            }
            Err(error) => Err(self.fail(error)),
        }
    }

    pub(super) fn validate(&self) -> Result<(), FirmwareUpdateError> {
        check(self.free_file()).map(|_| ())
    }

    /// Checks the file in the free partition and restarts with it soon.
    pub(super) fn activate(&mut self, now: u64) -> Result<(), FirmwareUpdateError> {
        self.validate()?;
        self.mark(now);
        Ok(())
    }

    fn mark(&mut self, now: u64) {
        self.next_start = self.free();
        self.status = STATUS_VERIFIED;
        self.reset_at = Some(now + RESET_DELAY_NS);
    }

    /// Whether a file is being received; nothing else may change the flash then.
    pub(super) fn is_receiving(&self) -> bool {
        self.transfer.is_some()
    }
}
