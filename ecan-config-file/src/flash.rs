//! The Flash of a gateway: saving, loading and restoring its configuration (manual 13.7).

use ecan_host::{Clock, Diagnostics, Maintenance, MaintenanceError};
use ecan_protocol::device::{AccessMode, MaintenanceCommand};

const MAINTENANCE: u16 = 0xB000;
const ACTIVE_CRC: u8 = 7;
const STORED_CRC: u8 = 8;

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

/// What is in a gateway after a command.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ConfigChecksums {
    /// CRC32 of the configuration in force, 0xB000:07.
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

    /// The access mode that the command needs. The manual names the modes, not what each permits:
    /// see docs/ASSUMPTIONS.md.
    fn mode(self) -> AccessMode {
        match self {
            Self::Save | Self::Load => AccessMode::Engineering,
            Self::Factory => AccessMode::Factory,
        }
    }

    /// Runs the command in the access mode that it needs, which is given back in any case, and reads
    /// the checksums.
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
    ) -> Result<ConfigChecksums, MaintenanceError> {
        let maintenance = Maintenance::new(bus, slave);
        maintenance.in_mode(self.mode(), || {
            maintenance.command(self.command(), clock)?;
            let crc = |subindex| bus.sdo_upload_u32(slave, MAINTENANCE, subindex);
            Ok(ConfigChecksums { active_crc: crc(ACTIVE_CRC)?, stored_crc: crc(STORED_CRC)? })
        })
    }
}
