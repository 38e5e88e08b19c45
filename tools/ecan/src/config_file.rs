//! Files that the user names: the configuration, and input of commands.

use std::path::Path;

use ecan_lite::EcrtOptions;
use ecan_lite::config::{
    ConfigFileError, ResolveError, ResolvedGateway, ServiceSettings, find, load, load_ecrt_options,
    load_service,
};
use ecan_mcan_port::Config;
use ecan_sim::ClockKind;

use crate::context::{Bus, Context, Failure, GlobalOptions, Result};

pub fn read(path: &Path) -> Result<Config> {
    load(path).map_err(failure)
}

/// Settings of the service in a file.
pub fn service(path: &Path) -> Result<ServiceSettings> {
    load_service(path).map_err(failure)
}

/// What a plain `sim` has for a file, or without one.
pub fn ecrt_options(path: Option<&Path>) -> Result<EcrtOptions> {
    path.map_or_else(|| Ok(EcrtOptions::default()), |path| load_ecrt_options(path).map_err(failure))
}

pub fn failure(error: ConfigFileError) -> Failure {
    match error {
        ConfigFileError::Read { path, reason } => Failure::file("read", &path, reason),
        ConfigFileError::Faults { path, faults } => Failure::file("use", &path, faults),
    }
}

/// Master of a file, unless the user selects another.
pub fn master(file: &Config, global: &GlobalOptions) -> u32 {
    global.master.unwrap_or(file.adapter.master_index)
}

pub fn open_bus(file: &Config, context: &Context, clock: ClockKind) -> Result<Bus> {
    let options = EcrtOptions::for_gateways(&file.adapter);
    context.bus_of_master(master(file, context.global), clock, options)
}

/// Gateways of a file on its bus: all, or the selected one.
pub fn resolve(file: &Config, bus: &Bus) -> Result<Vec<ResolvedGateway>> {
    let mut resolved = find(bus.diagnostics(), &file.adapter.slaves).map_err(resolve_failure)?;
    if bus.is_chosen() {
        let chosen = bus.slave()?;
        resolved.retain(|entry| entry.slave == chosen);
        if resolved.is_empty() {
            return Err(Failure::Slave(format!("slave {chosen} is not a gateway of the file")));
        }
    }
    Ok(resolved)
}

/// Opens the bus of a file and finds its gateways: all, or the selected one.
pub fn open_gateways(file: &Config, context: &Context) -> Result<(Bus, Vec<ResolvedGateway>)> {
    let bus = open_bus(file, context, ClockKind::Stepped)?;
    let resolved = resolve(file, &bus)?;
    Ok((bus, resolved))
}

pub fn resolve_failure(fault: ResolveError) -> Failure {
    match fault {
        ResolveError::Device(error) => Failure::Device(error),
        ResolveError::State { .. } => Failure::Rejected(fault.to_string()),
        ResolveError::NoAlias { .. } | ResolveError::NoSlave { .. } | ResolveError::Same { .. } => {
            Failure::Slave(fault.to_string())
        }
    }
}

/// Reads a file; `-` is standard input.
pub fn read_input(path: &Path) -> Result<Vec<u8>> {
    ecan_lite::config::read_bytes(path).map_err(|error| Failure::file("read", path, error))
}

/// Reads a text file; `-` is standard input.
pub fn read_input_text(path: &Path) -> Result<String> {
    String::from_utf8(read_input(path)?).map_err(|error| Failure::file("read", path, error))
}
