//! Maintenance of a gateway while no application runs.

use ecan_host::{Diagnostics, Maintenance, MaintenanceError};
use ecan_mcan_port::Config;
use ecan_protocol::device::{AccessMode, MaintenanceCommand};
use ecan_sim::Backend;
use serde::{Deserialize, Serialize};

/// A command to a gateway (manual 13.7).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Upkeep {
    Save,
    Load,
    Factory,
    RebuildEeprom,
}

impl Upkeep {
    pub const ALL: [Self; 4] = [Self::Save, Self::Load, Self::Factory, Self::RebuildEeprom];

    /// Executes the command. An error is one more thing that happens: the gateway may be away, or its flash fail.
    pub fn execute(self, backend: &Backend, config: &Config, slave: usize) {
        let (command, mode) = match self {
            Self::Save => (MaintenanceCommand::Save, AccessMode::Engineering),
            Self::Load => (MaintenanceCommand::Load, AccessMode::Engineering),
            Self::Factory => (MaintenanceCommand::Factory, AccessMode::Factory),
            Self::RebuildEeprom => (MaintenanceCommand::RebuildEeprom, AccessMode::Factory),
        };
        let Ok(bus) = Diagnostics::open(&backend.ecrt, &config.adapter) else { return };
        let maintenance = Maintenance::new(&bus, slave);
        let clock = backend.ecrt.clock().as_ref();
        let _: Result<(), MaintenanceError> =
            maintenance.in_mode(mode, || maintenance.command(command, clock));
    }
}
