//! Registers of a CAN controller through the register service (manual 13.6).

use ecan_protocol::device::{AccessMode, CCCR, CCCR_INIT, ControllerMode, TEST};
use thiserror::Error;

use super::diagnostics::Diagnostics;
use super::maintenance::{Maintenance, MaintenanceError};
use crate::error::Error;

const FIRST_OBJECT: u16 = 0xA000;
const OFFSET: u8 = 1;
const COMMAND: u8 = 2;
const STATUS: u8 = 3;
const WRITE_VALUE: u8 = 4;
const READ_VALUE: u8 = 5;

const READ: u8 = 1;
const WRITE: u8 = 2;
const OK: u32 = 0;
const DENIED: u32 = 4;

/// Error of an access to a register of a CAN controller.
#[derive(Debug, Error)]
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
        self.download(COMMAND, &[command])?;
        Ok(self.upload(STATUS)?)
    }

    fn upload(&self, subindex: u8) -> Result<u32, Error> {
        self.bus.sdo_upload_u32(self.slave, self.object, subindex)
    }

    fn download(&self, subindex: u8, data: &[u8]) -> Result<(), Error> {
        self.bus.sdo_download(self.slave, self.object, subindex, data)
    }
}
