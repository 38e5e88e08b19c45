//! A configuration file and the positions of its gateways on a bus.

use std::path::Path;

use ecan_config_file::{ConfigFileError, ResolveError, ResolvedGateway, find, load};
use ecan_mcan_port::Config;
use ecan_sim::ClockKind;

use crate::bus::Bus;
use crate::failure::Failure;
use crate::global::GlobalOptions;
use crate::output::Output;

/// Reads a valid file.
pub fn read(path: &Path) -> Result<Config, Failure> {
    load(path).map_err(|error| match error {
        ConfigFileError::Read { path, reason } => {
            Failure::File { what: "read", path, reason: reason.to_string() }
        }
        ConfigFileError::Faults { path, faults } => {
            Failure::File { what: "use", path, reason: faults.to_string() }
        }
    })
}

/// Master of a file, unless the user selects another.
pub fn master(file: &Config, global: &GlobalOptions) -> u32 {
    global.master.unwrap_or(file.adapter.master_index)
}

/// Opens the bus of a file.
pub fn open_bus(
    file: &Config,
    global: &GlobalOptions,
    output: &Output,
    clock: ClockKind,
) -> Result<Bus, Failure> {
    let master = Some(master(file, global));
    Bus::open_with_clock(&GlobalOptions { master, ..global.clone() }, output, clock)
}

/// Gateways of a file on its bus: all, or the selected one.
pub fn places(file: &Config, bus: &Bus) -> Result<Vec<ResolvedGateway>, Failure> {
    let mut places = find(bus.diagnostics(), &file.adapter.slaves).map_err(of_place)?;
    if bus.is_chosen() {
        let chosen = bus.slave()?;
        places.retain(|place| place.slave == chosen);
        if places.is_empty() {
            let words = format!("slave {chosen} is not a gateway of the file");
            return Err(Failure::Slave(words));
        }
    }
    Ok(places)
}

/// Converts the error of a gateway that cannot be addressed.
pub fn of_place(fault: ResolveError) -> Failure {
    match fault {
        ResolveError::Device(error) => Failure::Device(error),
        ResolveError::State { .. } => Failure::Rejected(fault.to_string()),
        ResolveError::NoAlias { .. } | ResolveError::NoSlave { .. } | ResolveError::Same { .. } => {
            Failure::Slave(fault.to_string())
        }
    }
}
