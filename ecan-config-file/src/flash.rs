//! The Flash of a gateway: saving, loading and restoring its configuration (manual 13.7).

use std::fmt;

use ecan_host::{Clock, Diagnostics, Error};
use thiserror::Error;

const MAINTENANCE: u16 = 0xB000;
const MODE_REQUEST: u8 = 1;
const MODE: u8 = 2;
const COMMAND: u8 = 4;
const STATUS: u8 = 5;
const ACTIVE_CRC: u8 = 7;
const STORED_CRC: u8 = 8;
const SEQUENCE: u8 = 12;
const RUN: u32 = 0;
const ENGINEERING: u32 = 1;
const FACTORY: u32 = 2;

/// Time between two looks at the sequence, in nanoseconds.
const POLL_NS: u64 = 10_000_000;
/// How long a command may take, in nanoseconds.
const TIMEOUT_NS: u64 = 10_000_000_000;

/// A command about the configuration in Flash, 0xB000:04.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FlashCommand {
    /// Saves the configuration that is in force.
    Save,
    /// Loads the saved configuration.
    Load,
    /// Restores the configuration of the factory, and forgets the saved one.
    Factory,
}

/// How a command ended: 0xB000:05. The manual gives numbers to 0 and 2 alone; the others follow the
/// order in which it names them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FlashStatus(pub u32);

impl fmt::Display for FlashStatus {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let words = match self.0 {
            0 => "OK",
            1 => "busy: another command is under way",
            2 => "denied: the state (OP) or the access mode does not permit it",
            3 => "CRC error: what is in the Flash is damaged; save anew or restore the factory's",
            4 => "image invalid: there is no saved configuration, or the firmware cannot use it",
            5 => "Flash error: the Flash could not be written",
            _ => "not in the manual",
        };
        write!(f, "{} ({words})", self.0)
    }
}

/// What is in a gateway after a command.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FlashDone {
    /// CRC32 of the configuration in force, 0xB000:07.
    pub active_crc: u32,
    /// CRC32 of the saved configuration, 0xB000:08.
    pub stored_crc: u32,
}

/// Why a command failed.
#[derive(Debug, Error)]
pub enum FlashError {
    /// A transfer failed.
    #[error(transparent)]
    Device(#[from] Error),
    /// The gateway does not grant the access mode.
    #[error(
        "the gateway does not grant the access mode {wanted}, it stays in {found} (0xB000:01, :02)"
    )]
    Mode {
        /// 1 engineering, 2 factory.
        wanted: u32,
        /// The mode that it has.
        found: u32,
    },
    /// The gateway refused or failed.
    #[error("the gateway ended the command with status {0}")]
    Status(FlashStatus),
    /// The sequence did not count.
    #[error("the command did not end within {} s (0xB000:12 stands still)", TIMEOUT_NS / 1_000_000_000)]
    Unended,
}

impl FlashCommand {
    fn bits(self) -> u8 {
        match self {
            Self::Save => 1 << 0,
            Self::Load => 1 << 1,
            Self::Factory => 1 << 2,
        }
    }

    /// The access mode that the command needs. The manual names the modes, not what each permits:
    /// see docs/ASSUMPTIONS.md.
    fn mode(self) -> u32 {
        match self {
            Self::Save | Self::Load => ENGINEERING,
            Self::Factory => FACTORY,
        }
    }

    /// Runs the command: requests the access mode, notes the sequence, commands, waits until the
    /// sequence has counted, judges the status, and gives the access mode back in any case.
    ///
    /// Blocks, up to 10 s. Not in OP, where the gateway denies it.
    ///
    /// # Errors
    /// What failed, in words.
    pub fn run(
        self,
        bus: &Diagnostics,
        slave: usize,
        clock: &dyn Clock,
    ) -> Result<FlashDone, FlashError> {
        let before = read(bus, slave, MODE)?;
        let needs_mode = before < self.mode();
        let outcome = self.run_in_mode(bus, slave, clock, needs_mode);
        if needs_mode {
            // A gateway that was in engineering mode goes back there.
            let mode = before.min(FACTORY) as u8;
            let given_back = bus.sdo_download(slave, MAINTENANCE, MODE_REQUEST, &[mode]);
            outcome.and_then(|done| given_back.map(|()| done).map_err(FlashError::Device))
        } else {
            outcome
        }
    }

    fn run_in_mode(
        self,
        bus: &Diagnostics,
        slave: usize,
        clock: &dyn Clock,
        needs_mode: bool,
    ) -> Result<FlashDone, FlashError> {
        let wanted = self.mode();
        if needs_mode {
            bus.sdo_download(slave, MAINTENANCE, MODE_REQUEST, &[wanted as u8])?;
            let found = read(bus, slave, MODE)?;
            if found < wanted || found == RUN {
                return Err(FlashError::Mode { wanted, found });
            }
        }
        let sequence = read(bus, slave, SEQUENCE)?;
        bus.sdo_download(slave, MAINTENANCE, COMMAND, &[self.bits()])?;
        let deadline = clock.now_ns().saturating_add(TIMEOUT_NS);
        while read(bus, slave, SEQUENCE)? == sequence {
            let now = clock.now_ns();
            if now >= deadline {
                return Err(FlashError::Unended);
            }
            clock.sleep_until_ns(now.saturating_add(POLL_NS));
        }
        match read(bus, slave, STATUS)? {
            0 => Ok(FlashDone {
                active_crc: read(bus, slave, ACTIVE_CRC)?,
                stored_crc: read(bus, slave, STORED_CRC)?,
            }),
            status => Err(FlashError::Status(FlashStatus(status))),
        }
    }
}

fn read(bus: &Diagnostics, slave: usize, subindex: u8) -> Result<u32, Error> {
    bus.sdo_upload_u32(slave, MAINTENANCE, subindex)
}
