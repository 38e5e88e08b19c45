//! A configuration file, and where its gateways are on a bus.

use std::path::Path;

use ecan_config_file::{ConfigFile, ConfigFileError, ResolveError, ResolvedGateway, find, load};
use ecan_sim::ClockKind;

use crate::bus::Bus;
use crate::failure::Failure;
use crate::global::GlobalOptions;
use crate::output::Output;

/// Reads a file that must be sound.
pub fn read(path: &Path) -> Result<ConfigFile, Failure> {
    load(path).map_err(|error| match error {
        ConfigFileError::Read { path, reason } => {
            Failure::File { what: "read", path, reason: reason.to_string() }
        }
        ConfigFileError::Faults { path, faults } => {
            Failure::File { what: "use", path, reason: faults.to_string() }
        }
    })
}

/// The master of a file, unless the user names another.
pub fn master(file: &ConfigFile, global: &GlobalOptions) -> u32 {
    global.master.unwrap_or(file.adapter.master_index)
}

/// Opens the bus that a file is about.
pub fn open_bus(
    file: &ConfigFile,
    global: &GlobalOptions,
    output: &Output,
    clock: ClockKind,
) -> Result<Bus, Failure> {
    let master = Some(master(file, global));
    Bus::open_with_clock(&GlobalOptions { master, ..global.clone() }, output, clock)
}

/// The places of a file's gateways on its bus: all, or the one chosen.
pub fn places(file: &ConfigFile, bus: &Bus) -> Result<Vec<ResolvedGateway>, Failure> {
    let mut places = find(bus.diagnostics(), &file.adapter.slaves).map_err(of_place)?;
    if bus.is_chosen() {
        let chosen = bus.slave()?;
        places.retain(|place| place.slave == chosen);
        if places.is_empty() {
            let words = format!("slave {chosen} is no gateway of the file");
            return Err(Failure::Slave(words));
        }
    }
    Ok(places)
}

/// Why a gateway of a file cannot be addressed.
pub fn of_place(fault: ResolveError) -> Failure {
    match fault {
        ResolveError::Device(error) => Failure::Device(error),
        ResolveError::State { .. } => Failure::Refused(fault.to_string()),
        ResolveError::NoAlias { .. } | ResolveError::NoSlave { .. } | ResolveError::Same { .. } => {
            Failure::Slave(fault.to_string())
        }
    }
}
