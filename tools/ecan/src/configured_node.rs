//! CANopen nodes of a configuration file, selected by name.

use std::path::{Path, PathBuf};

use ecan_canopen::{NetworkDescription, NodeDescription, NodeId};
use ecan_mcan_port::Config;
use ecan_protocol::text::Printable;

use crate::config_file;
use crate::failure::{Failure, Result};
use crate::slave_choice::SlaveChoice;

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
        let config = config_file::read(path)?;
        let network = ecan_lite::config::load_network(path).map_err(config_file::failure)?;
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
