//! Registers of a CAN controller by the register service (manual 13.6).

use ecan_host::{CanController, MaintenanceError, RegisterServiceError};
use ecan_protocol::device::ControllerMode;

use crate::probe::interruption::{Interruption, Result};
use crate::probe::sdo::Sdo;

pub(crate) const ENDN: u16 = 0x04;
pub(crate) const DBTP: u16 = 0x0C;
pub(crate) const NBTP: u16 = 0x1C;

impl From<MaintenanceError> for Interruption {
    fn from(error: MaintenanceError) -> Self {
        match error {
            MaintenanceError::Device(error) => error.into(),
            other => Self::Unavailable(other.to_string()),
        }
    }
}

impl From<RegisterServiceError> for Interruption {
    fn from(error: RegisterServiceError) -> Self {
        match error {
            RegisterServiceError::Maintenance(error) => error.into(),
            status => Self::Unavailable(status.to_string()),
        }
    }
}

/// Reads a register; requests engineering mode only if the gateway demands it, and restores the mode.
pub(crate) fn read(sdo: Sdo<'_>, channel: u8, offset: u16) -> Result<u32> {
    Ok(CanController::new(sdo.diagnostics, sdo.slave, channel).read(offset)?)
}

/// Reads the mode of a controller.
pub(crate) fn mode(sdo: Sdo<'_>, channel: u8) -> Result<ControllerMode> {
    Ok(CanController::new(sdo.diagnostics, sdo.slave, channel).mode()?)
}

/// Sample point in 0.1 % of a value of NBTP, or of DBTP if `is_data`.
pub(crate) fn sample_point(value: u32, is_data: bool) -> u32 {
    let (tseg1, tseg2) = match is_data {
        false => ((value >> 8 & 0xFF) + 1, (value & 0x7F) + 1),
        true => ((value >> 8 & 0x1F) + 1, (value >> 4 & 0x0F) + 1),
    };
    (1 + tseg1) * 1000 / (1 + tseg1 + tseg2)
}
