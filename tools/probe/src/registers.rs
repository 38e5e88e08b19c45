//! Registers of a CAN controller by the register service (manual 13.6).

use ecan_host::{Diagnostics, Maintenance, MaintenanceError};
use ecan_protocol::device::AccessMode;

use crate::interruption::{Interruption, Result, unavailable};
use crate::sdo::Sdo;

pub(crate) const ENDN: u16 = 0x04;
pub(crate) const DBTP: u16 = 0x0C;
pub(crate) const TEST: u16 = 0x10;
pub(crate) const CCCR: u16 = 0x18;
pub(crate) const NBTP: u16 = 0x1C;

/// CCCR.MON: bus monitoring.
const CCCR_MON: u32 = 1 << 5;
/// TEST.LBCK: loopback.
const TEST_LBCK: u32 = 1 << 4;

const DENIED: u32 = 4;

impl From<MaintenanceError> for Interruption {
    fn from(error: MaintenanceError) -> Self {
        match error {
            MaintenanceError::Device(error) => error.into(),
            other => Self::Unavailable(other.to_string()),
        }
    }
}

/// Reads a register; requests engineering mode only if the gateway demands it, and restores the mode.
pub(crate) fn read(sdo: Sdo<'_>, channel: u8, offset: u16) -> Result<u32> {
    let object = 0xA000 + u16::from(channel);
    let command = || -> Result<u32> {
        sdo.write(object, 1, offset.into())?;
        sdo.write(object, 2, 1)?;
        sdo.read(object, 3)
    };
    let status = match command()? {
        DENIED => Maintenance::new(sdo.diagnostics, sdo.slave)
            .in_mode(AccessMode::Engineering, command)?,
        status => status,
    };
    match status {
        0 => sdo.read(object, 5),
        status => unavailable(format!("register service 0x{object:04X}: status {status}")),
    }
}

/// Mode of a CAN controller, by its registers CCCR and TEST.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ControllerMode {
    /// Takes part in the bus.
    Normal,
    /// Receives only.
    Listen,
    /// Receives its own frames; the bus does not see them.
    InternalLoopback,
    /// Receives its own frames and drives the bus.
    ExternalLoopback,
}

/// Reads the mode of a CAN controller (manual 13.6).
///
/// # Errors
/// The gateway does not respond, or its register service rejects the access.
pub fn controller_mode(
    diagnostics: &Diagnostics,
    slave: usize,
    channel: u8,
) -> Result<ControllerMode> {
    ControllerMode::read(Sdo { diagnostics, slave }, channel)
}

impl ControllerMode {
    pub(crate) fn of(cccr: u32, test: u32) -> Self {
        match (cccr & CCCR_MON != 0, test & TEST_LBCK != 0) {
            (false, false) => Self::Normal,
            (true, false) => Self::Listen,
            (true, true) => Self::InternalLoopback,
            (false, true) => Self::ExternalLoopback,
        }
    }

    pub(crate) fn read(sdo: Sdo<'_>, channel: u8) -> Result<Self> {
        Ok(Self::of(read(sdo, channel, CCCR)?, read(sdo, channel, TEST)?))
    }

    /// Name in a sentence.
    pub fn text(self) -> &'static str {
        match self {
            Self::Normal => "normal operation",
            Self::Listen => "listen-only",
            Self::InternalLoopback => "internal loopback",
            Self::ExternalLoopback => "external loopback",
        }
    }
}

/// Sample point in 0.1 % of a value of NBTP, or of DBTP if `is_data`.
pub(crate) fn sample_point(value: u32, is_data: bool) -> u32 {
    let (tseg1, tseg2) = match is_data {
        false => ((value >> 8 & 0xFF) + 1, (value & 0x7F) + 1),
        true => ((value >> 8 & 0x1F) + 1, (value >> 4 & 0x0F) + 1),
    };
    (1 + tseg1) * 1000 / (1 + tseg1 + tseg2)
}
