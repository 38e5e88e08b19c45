//! Files that the user names: the configuration with its nodes, and input of commands.

use std::path::{Path, PathBuf};

use ecan_canopen::{NetworkDescription, NodeDescription, NodeId};
use ecan_lite::EcrtOptions;
use ecan_lite::config::{
    ConfigFileError, ResolveError, ResolvedGateway, ServiceSettings, find, load, load_ecrt_options,
    load_service,
};
use ecan_mcan_port::Config;
use ecan_protocol::text::Printable;
use ecan_sim::ClockKind;

use crate::context::{Bus, Context, Failure, GlobalOptions, Result};
use crate::slave_choice::SlaveChoice;

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

/// The nodes of a configuration file: the tables `[[node]]` and `[[axis]]`, and those of `[[bus]]`.
#[derive(Debug)]
pub struct ConfiguredNodes {
    path: PathBuf,
    config: Config,
    network: NetworkDescription,
}

impl ConfiguredNodes {
    /// Reads the file with its device files.
    ///
    /// # Errors
    /// The file cannot be read or has faults.
    pub fn load(path: &Path) -> Result<Self> {
        let config = read(path)?;
        let network = ecan_lite::config::load_network(path).map_err(failure)?;
        Ok(Self { path: path.to_owned(), config, network })
    }

    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Master of the file.
    pub fn config(&self) -> &Config {
        &self.config
    }

    /// The node with this name, without regard to case. The slave of its address is the index of the
    /// gateway in the file.
    ///
    /// # Errors
    /// No node or several nodes have the name.
    pub fn named(&self, name: &str) -> Result<&NodeDescription> {
        let nodes = &self.network.nodes;
        let found: Vec<_> =
            nodes.iter().filter(|node| node.name.eq_ignore_ascii_case(name)).collect();
        let path = Printable(self.path.display());
        match found[..] {
            [node] => Ok(node),
            [] => {
                let names = nodes.iter().map(|node| node.name.as_str());
                let names: Vec<_> = names.filter(|name| !name.is_empty()).collect();
                let allowed = match names.is_empty() {
                    true => "no node of the file has a `name`".to_owned(),
                    false => format!("allowed: {}", names.join(", ")),
                };
                Err(Failure::Usage(format!("{path} has no node \"{name}\"; {allowed}")))
            }
            _ => {
                let addresses: Vec<_> = found.iter().map(|node| node.address.to_string()).collect();
                Err(Failure::Usage(format!(
                    "{path} has several nodes \"{name}\": {}; change their names",
                    addresses.join(", ")
                )))
            }
        }
    }

    /// The node on a channel of the only gateway of the file; `None` for a file with several.
    pub fn of_only_gateway(&self, channel: u8, node: NodeId) -> Option<&NodeDescription> {
        let has_address = |described: &&NodeDescription| {
            (described.address.channel, described.address.node) == (channel, node)
        };
        self.network
            .nodes
            .iter()
            .find(has_address)
            .filter(|_| self.config.adapter.slaves.len() == 1)
    }

    /// The slave of a gateway of the file, by its index there; `None` if the file has only this one.
    ///
    /// # Errors
    /// The gateway has a position after an alias, which `--slave` cannot state.
    pub fn slave_of(&self, gateway: usize) -> Result<Option<SlaveChoice>> {
        let slaves = &self.config.adapter.slaves;
        let Some(slave) = slaves.get(gateway).filter(|_| slaves.len() > 1) else { return Ok(None) };
        match (slave.alias, slave.position) {
            (0, position) => Ok(Some(SlaveChoice::Position(position.into()))),
            (alias, 0) => Ok(Some(SlaveChoice::Alias(alias))),
            (alias, position) => Err(Failure::Usage(format!(
                "gateway {gateway} of {} is {position} after alias {alias}; select it with --slave, \
                 and the node by its node-ID without --config",
                Printable(self.path.display())
            ))),
        }
    }
}
