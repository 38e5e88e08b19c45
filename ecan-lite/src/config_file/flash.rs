//! Saving, loading and restoring the configuration of a gateway in its flash (manual 13.7).

use ecan_host::{Clock, Diagnostics, Maintenance, MaintenanceError};
use ecan_protocol::device::{AccessMode, MaintenanceCommand};

const MAINTENANCE: u16 = 0xB000;
const ACTIVE_CRC: u8 = 7;
const STORED_CRC: u8 = 8;

/// A command for the configuration in the flash, 0xB000:04.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FlashCommand {
    /// Saves the active configuration.
    Save,
    /// Loads the saved configuration.
    Load,
    /// Restores the factory configuration and deletes the saved one.
    Factory,
}

/// Checksums of the configurations of a gateway after a command.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ConfigChecksums {
    /// CRC32 of the active configuration, 0xB000:07.
    pub active_crc: u32,
    /// CRC32 of the saved configuration, 0xB000:08.
    pub stored_crc: u32,
}

impl FlashCommand {
    fn command(self) -> MaintenanceCommand {
        match self {
            Self::Save => MaintenanceCommand::Save,
            Self::Load => MaintenanceCommand::Load,
            Self::Factory => MaintenanceCommand::Factory,
        }
    }

    /// The access mode that the command needs. The manual does not define what each mode permits; see
    /// docs/ASSUMPTIONS.md.
    fn mode(self) -> AccessMode {
        match self {
            Self::Save | Self::Load => AccessMode::Engineering,
            Self::Factory => AccessMode::Factory,
        }
    }

    /// Runs the command in the access mode that it needs, restores the previous mode in any case, and
    /// reads the checksums.
    ///
    /// Blocks up to 10 s. The gateway denies the command in OP.
    ///
    /// # Errors
    /// [`MaintenanceError`] of the step that failed.
    pub fn run(
        self,
        bus: &Diagnostics,
        slave: usize,
        clock: &dyn Clock,
    ) -> Result<ConfigChecksums, MaintenanceError> {
        let maintenance = Maintenance::new(bus, slave);
        maintenance.in_mode(self.mode(), || {
            maintenance.command(self.command(), clock)?;
            let crc = |subindex| bus.sdo_upload_u32(slave, MAINTENANCE, subindex);
            Ok(ConfigChecksums { active_crc: crc(ACTIVE_CRC)?, stored_crc: crc(STORED_CRC)? })
        })
    }
}
