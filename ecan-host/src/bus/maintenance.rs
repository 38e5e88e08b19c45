//! Maintenance of a gateway by 0xB000: access modes that are given back, commands that are waited for
//! (manual 13.7).

use ecan_protocol::device::{AccessMode, MaintenanceCommand, MaintenanceStatus};
use ecrt_sys::Clock;
use thiserror::Error;

use super::diagnostics::Diagnostics;
use crate::error::Error;

const OBJECT: u16 = 0xB000;
const MODE_REQUEST: u8 = 1;
const MODE: u8 = 2;
const COMMAND: u8 = 4;
const STATUS: u8 = 5;
const SEQUENCE: u8 = 12;

/// Time between two looks at the sequence, in nanoseconds.
const POLL_NS: u64 = 10_000_000;
/// How long a command may take, in nanoseconds.
const TIMEOUT_NS: u64 = 10_000_000_000;

/// Why maintenance of a gateway failed.
#[derive(Debug, Error)]
pub enum MaintenanceError {
    /// A transfer failed.
    #[error(transparent)]
    Device(#[from] Error),
    /// The gateway does not grant the access mode.
    #[error("the gateway does not grant {wanted} mode: its access mode stays {found} (0xB000:02)")]
    Mode {
        /// The mode that was asked for.
        wanted: AccessMode,
        /// The mode that it has: 0 run, 1 engineering, 2 factory.
        found: u32,
    },
    /// The gateway refused or failed.
    #[error("the gateway ended the command with status {0}")]
    Status(MaintenanceStatus),
    /// The sequence did not count.
    #[error("the command did not end within {} s (0xB000:12 stands still)", TIMEOUT_NS / 1_000_000_000)]
    Unended,
}

/// 0xB000 of one gateway.
///
/// All of it blocks, and none is for the cycle.
#[derive(Clone, Copy, Debug)]
pub struct Maintenance<'a> {
    bus: &'a Diagnostics,
    slave: usize,
}

impl<'a> Maintenance<'a> {
    /// Of the slave with this index in `bus`.
    pub fn new(bus: &'a Diagnostics, slave: usize) -> Self {
        Self { bus, slave }
    }

    fn read(&self, subindex: u8) -> Result<u32, Error> {
        self.bus.sdo_upload_u32(self.slave, OBJECT, subindex)
    }

    fn write(&self, subindex: u8, value: u8) -> Result<(), Error> {
        self.bus.sdo_download(self.slave, OBJECT, subindex, &[value])
    }

    /// Does something in an access mode and gives the mode back, whatever comes of it. A gateway that
    /// has the mode already, or one with more rights, keeps it: somebody else asked for it.
    ///
    /// # Errors
    /// [`MaintenanceError::Mode`] or the transfer that failed; what `action` returns; and the transfer
    /// that was to give the mode back, where `action` went well.
    pub fn in_mode<R, E: From<MaintenanceError>>(
        &self,
        wanted: AccessMode,
        action: impl FnOnce() -> Result<R, E>,
    ) -> Result<R, E> {
        let rights = u32::from(wanted.raw());
        let before = self.read(MODE).map_err(MaintenanceError::Device)?;
        if before >= rights {
            return action();
        }
        let outcome = match self.request(wanted) {
            Ok(()) => action(),
            Err(error) => Err(error.into()),
        };
        // Below the mode that was asked for, so it is one of the three.
        let given_back = self.write(MODE_REQUEST, before as u8).map_err(MaintenanceError::Device);
        let value = outcome?;
        given_back?;
        Ok(value)
    }

    fn request(&self, wanted: AccessMode) -> Result<(), MaintenanceError> {
        self.write(MODE_REQUEST, wanted.raw())?;
        let found = self.read(MODE)?;
        match found >= u32::from(wanted.raw()) {
            true => Ok(()),
            false => Err(MaintenanceError::Mode { wanted, found }),
        }
    }

    /// Gives a command: notes the sequence, commands, waits until the sequence has counted, and judges
    /// the status. Up to 10 s by `clock`.
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
