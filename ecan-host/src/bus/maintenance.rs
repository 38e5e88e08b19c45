//! Maintenance of a gateway through 0xB000 (manual 13.7), and the registers of its CAN controllers
//! through 0xA000 to 0xA003 (manual 13.6).

use ecan_protocol::device::{
    AccessMode, CCCR, CCCR_INIT, ControllerMode, MaintenanceCommand, MaintenanceStatus, TEST,
};
use ecrt_sys::Clock;

use super::diagnostics::Diagnostics;
use crate::error::Error;

const OBJECT: u16 = 0xB000;
const MODE_REQUEST: u8 = 1;
const MODE: u8 = 2;
const COMMAND: u8 = 4;
const STATUS: u8 = 5;
const SEQUENCE: u8 = 12;

const POLL_NS: u64 = 10_000_000;
const TIMEOUT_NS: u64 = 10_000_000_000;

/// Error of a maintenance command.
#[derive(Debug, thiserror::Error)]
pub enum MaintenanceError {
    /// A transfer failed.
    #[error(transparent)]
    Device(#[from] Error),
    /// The gateway does not grant the access mode.
    #[error(
        "the gateway does not grant {requested} mode: its access mode stays {found} (0xB000:02)"
    )]
    Mode {
        /// The requested mode.
        requested: AccessMode,
        /// The mode that it has: 0 run, 1 engineering, 2 factory.
        found: u32,
    },
    /// The gateway rejected the command, or the command failed.
    #[error("the gateway ended the command with status {}{}", .0, assumption(*.0))]
    Status(MaintenanceStatus),
    /// The sequence did not change.
    #[error("the command did not end within {} s (0xB000:12 unchanged)", TIMEOUT_NS / 1_000_000_000)]
    Unended,
}

/// The assumption that a status contradicts: the command is sent in the mode that it should need.
fn assumption(status: MaintenanceStatus) -> &'static str {
    match status {
        MaintenanceStatus::Denied => " (assumption H27: it may need another access mode)",
        MaintenanceStatus::CrcError | MaintenanceStatus::ImageInvalid => {
            " (assumption H27: the firmware may use other numbers)"
        }
        _ => "",
    }
}

/// 0xB000 of one gateway.
///
/// Every call blocks; none is for the cycle.
#[derive(Clone, Copy, Debug)]
pub struct Maintenance<'a> {
    bus: &'a Diagnostics,
    slave: usize,
}

impl<'a> Maintenance<'a> {
    /// Maintenance of the slave with this index in `bus`.
    pub fn new(bus: &'a Diagnostics, slave: usize) -> Self {
        Self { bus, slave }
    }

    fn read(&self, subindex: u8) -> Result<u32, Error> {
        self.bus.sdo_upload_u32(self.slave, OBJECT, subindex)
    }

    fn write(&self, subindex: u8, value: u8) -> Result<(), Error> {
        self.bus.sdo_download_once(self.slave, OBJECT, subindex, &[value])
    }

    /// Executes `action` in an access mode and restores the previous mode, also after an error. A
    /// gateway that has the mode already, or one with more rights, keeps it: another application
    /// requested it.
    ///
    /// # Errors
    /// [`MaintenanceError::Mode`] or the failed transfer; the error of `action`; the failed transfer
    /// that restores the mode, if `action` succeeded.
    pub fn in_mode<R, E: From<MaintenanceError>>(
        &self,
        requested: AccessMode,
        action: impl FnOnce() -> Result<R, E>,
    ) -> Result<R, E> {
        let rights = u32::from(requested.raw());
        let before = self.read(MODE).map_err(MaintenanceError::Device)?;
        if before >= rights {
            return action();
        }
        let outcome = match self.request(requested) {
            Ok(()) => action(),
            Err(error) => Err(error.into()),
        };
        // Below the requested mode, so it is one of the three.
        let restored = self.write(MODE_REQUEST, before as u8).map_err(MaintenanceError::Device);
        let value = outcome?;
        restored?;
        Ok(value)
    }

    fn request(&self, requested: AccessMode) -> Result<(), MaintenanceError> {
        self.write(MODE_REQUEST, requested.raw())?;
        let found = self.read(MODE)?;
        match found >= u32::from(requested.raw()) {
            true => Ok(()),
            false => Err(MaintenanceError::Mode { requested, found }),
        }
    }

    /// Executes a command: writes it, waits until the sequence changes, and checks the status. Up to
    /// 10 s by `clock`.
    ///
    /// # Errors
    /// A transfer that failed, the status of the gateway, or that the command does not end.
    pub fn command(
        &self,
        command: MaintenanceCommand,
        clock: &dyn Clock,
    ) -> Result<(), MaintenanceError> {
        let before = self.read(SEQUENCE)?;
        self.write(COMMAND, command.raw())?;
        let deadline = clock.now_ns().saturating_add(TIMEOUT_NS);
        while self.read(SEQUENCE)? == before {
            let now = clock.now_ns();
            if now >= deadline {
                return Err(MaintenanceError::Unended);
            }
            clock.sleep_until_ns(now.saturating_add(POLL_NS));
        }
        let raw = u8::try_from(self.read(STATUS)?).unwrap_or(u8::MAX);
        match MaintenanceStatus::from_raw(raw) {
            MaintenanceStatus::Ok => Ok(()),
            status => Err(MaintenanceError::Status(status)),
        }
    }
}

const FIRST_OBJECT: u16 = 0xA000;
const OFFSET: u8 = 1;
const REGISTER_COMMAND: u8 = 2;
const REGISTER_STATUS: u8 = 3;
const WRITE_VALUE: u8 = 4;
const READ_VALUE: u8 = 5;

const READ: u8 = 1;
const WRITE: u8 = 2;
const OK: u32 = 0;
const DENIED: u32 = 4;

/// Error of an access to a register of a CAN controller.
#[derive(Debug, thiserror::Error)]
pub enum RegisterServiceError {
    /// A transfer failed, or the gateway does not grant the access mode.
    #[error(transparent)]
    Maintenance(#[from] MaintenanceError),
    /// The service rejected the access.
    #[error("register service 0x{object:04X}: status {status}")]
    Status {
        /// 0xA000 to 0xA003.
        object: u16,
        /// 1 wrong offset, 2 not writable, 3 busy, 4 access denied.
        status: u32,
    },
    /// The controller is still on its bus.
    #[error("CCCR.INIT did not stay set; restart the gateway (0x8000:01)")]
    InitNotSet,
}

impl From<Error> for RegisterServiceError {
    fn from(error: Error) -> Self {
        Self::Maintenance(error.into())
    }
}

/// CAN controller of a channel.
///
/// Every call blocks; none is for the cycle.
#[derive(Clone, Copy, Debug)]
pub struct CanController<'a> {
    bus: &'a Diagnostics,
    slave: usize,
    object: u16,
}

impl<'a> CanController<'a> {
    /// Of a channel, 0 to 3, of the slave with this index in `bus`.
    pub fn new(bus: &'a Diagnostics, slave: usize, channel: u8) -> Self {
        Self { bus, slave, object: FIRST_OBJECT + u16::from(channel) }
    }

    /// Reads a register by its offset. Requests engineering mode only if the gateway demands it, and
    /// restores the mode.
    ///
    /// # Errors
    /// A transfer fails, or the service rejects the access.
    pub fn read(&self, offset: u16) -> Result<u32, RegisterServiceError> {
        self.permitted(|| self.command(offset, READ))?;
        Ok(self.upload(READ_VALUE)?)
    }

    /// Writes a register by its offset, in engineering mode as [`read`](Self::read).
    ///
    /// # Errors
    /// A transfer fails, the mode is not granted, or the service rejects the access.
    pub fn write(&self, offset: u16, value: u32) -> Result<(), RegisterServiceError> {
        self.download(WRITE_VALUE, &value.to_le_bytes())?;
        self.permitted(|| self.command(offset, WRITE))
    }

    /// Mode of the controller.
    ///
    /// # Errors
    /// As [`read`](Self::read).
    pub fn mode(&self) -> Result<ControllerMode, RegisterServiceError> {
        Ok(ControllerMode::of(self.read(CCCR)?, self.read(TEST)?))
    }

    /// Stops the controller by CCCR.INIT, so that it leaves its bus; applying the channel (0x8001:01)
    /// or a restart of the gateway starts it again.
    ///
    /// # Errors
    /// As [`write`](Self::write), or the bit is not set afterwards.
    pub fn leave_bus(&self) -> Result<(), RegisterServiceError> {
        let value = self.read(CCCR)?;
        self.write(CCCR, value | CCCR_INIT)?;
        match self.read(CCCR)? & CCCR_INIT {
            0 => Err(RegisterServiceError::InitNotSet),
            _ => Ok(()),
        }
    }

    fn permitted(
        &self,
        access: impl Fn() -> Result<u32, RegisterServiceError>,
    ) -> Result<(), RegisterServiceError> {
        let status = match access()? {
            DENIED => {
                Maintenance::new(self.bus, self.slave).in_mode(AccessMode::Engineering, access)?
            }
            status => status,
        };
        match status {
            OK => Ok(()),
            status => Err(RegisterServiceError::Status { object: self.object, status }),
        }
    }

    fn command(&self, offset: u16, command: u8) -> Result<u32, RegisterServiceError> {
        self.download(OFFSET, &u32::from(offset).to_le_bytes())?;
        self.download(REGISTER_COMMAND, &[command])?;
        Ok(self.upload(REGISTER_STATUS)?)
    }

    fn upload(&self, subindex: u8) -> Result<u32, Error> {
        self.bus.sdo_upload_u32(self.slave, self.object, subindex)
    }

    fn download(&self, subindex: u8, data: &[u8]) -> Result<(), Error> {
        self.bus.sdo_download(self.slave, self.object, subindex, data)
    }
}
