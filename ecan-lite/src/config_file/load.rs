//! Reads a configuration file, or its parts.

use std::collections::BTreeMap;
use std::path::Path;

use ecan_canopen::{NetworkDescription, NodeDescription};
use ecan_cia402::AxisConfig;
use ecan_host::{Expectation, StartupStep};
use ecan_mcan_port::Config;

use super::bus::ServiceSettings;
use super::device_profile::IncludedProfile;
use crate::config_file::bus::{self, Bus};
use crate::config_file::document::{Document, Includes, Table};
use crate::config_file::fault::{ConfigFileError, FileFaults};
use crate::config_file::input::load_by;
use crate::config_file::network::NetworkSettings;
use crate::config_file::{axis, check, node};

/// Returns the complete startup sequence of a gateway (manual 5.4.3, phases A to E, and 13.2.2):
/// checks of its capabilities, PDO assignment, profiles, channels with their filters and data paths,
/// each with its readback. Checks that every value passes are omitted. Empty for a gateway that the
/// configuration does not have.
pub fn startup(config: &Config, gateway: usize) -> Vec<StartupStep> {
    let mut steps = config.port.startup_plan(&config.adapter).steps(&config.adapter, gateway);
    steps.retain(|step| {
        let StartupStep::Expect { expected, .. } = step else { return true };
        !matches!(expected, Expectation::HasBits(0) | Expectation::AtLeast(0))
    });
    steps
}

fn read(bytes: &[u8], includes: Includes) -> Result<Bus, FileFaults> {
    Document::read(bytes, includes, |document, root| {
        let bus = bus::read(Table::root(document, root));
        if document.is_valid_toml() {
            check::check(document, &bus.config);
            axis::check(document, &bus.config, &bus.axes);
            node::check(document, &bus.config, &bus.network, &bus.nodes, &bus.axes);
        }
        bus
    })
}

/// Reads a configuration from the bytes of a file, which are UTF-8. They cannot include a device
/// profile, whose path is relative to the file: [`load`] can.
///
/// # Errors
/// Every fault, with line and column; bytes that are not UTF-8 do not hide other faults.
pub fn parse(bytes: &[u8]) -> Result<Config, FileFaults> {
    Ok(read(bytes, Includes::None)?.config)
}

/// As [`parse`], with the texts of the device profiles that it includes, by their names in it: for a
/// configuration that another program has sent.
///
/// # Errors
/// As [`parse`].
pub fn parse_with(bytes: &[u8], texts: BTreeMap<String, String>) -> Result<Config, FileFaults> {
    Ok(read(bytes, Includes::Texts(texts))?.config)
}

/// Reads the axes of a configuration from the bytes of a file, in their order; empty without axes.
///
/// # Errors
/// Every fault of the file, with line and column.
pub fn parse_axes(bytes: &[u8]) -> Result<Vec<AxisConfig>, FileFaults> {
    Ok(read(bytes, Includes::None)?.axes.into_iter().flatten().map(|axis| axis.config).collect())
}

/// Reads a configuration from a file of at most 16 MiB, like the functions below. The path `-` is standard
/// input; files that it includes are relative to the current directory then.
///
/// # Errors
/// [`ConfigFileError`]: the file cannot be read, or every fault of it, with line and column.
pub fn load(path: impl AsRef<Path>) -> Result<Config, ConfigFileError> {
    Ok(load_bus(path.as_ref())?.config)
}

/// Reads the axes of a configuration from a file of at most 16 MiB, in their order: the axis table
/// for `Cia402::new`, which also checks what depends on the target period. Empty without axes.
///
/// # Errors
/// [`ConfigFileError`]: the file cannot be read, or every fault of it, with line and column.
pub fn load_axes(path: impl AsRef<Path>) -> Result<Vec<AxisConfig>, ConfigFileError> {
    Ok(load_bus(path.as_ref())?.axes.into_iter().flatten().map(|axis| axis.config).collect())
}

/// Reads the names of the axes of [`load_axes`], in the same order: those of their nodes. `None` for an
/// axis without a node, or of a node without a name. An axis of a node with several has its number in the
/// node, too: `gantry/0`, `gantry/1`.
///
/// # Errors
/// [`ConfigFileError`]: the file cannot be read, or every fault of it, with line and column.
pub fn load_axis_names(path: impl AsRef<Path>) -> Result<Vec<Option<String>>, ConfigFileError> {
    let Bus { axes, nodes, .. } = load_bus(path.as_ref())?;
    let axes: Vec<AxisConfig> = axes.into_iter().flatten().map(|axis| axis.config).collect();
    let name = |axis: &AxisConfig| {
        let mut nodes = nodes.iter().map(|node| &node.node.description);
        let name = &nodes.find(|node| node.address == axis.address)?.name;
        let is_shared = axes.iter().filter(|other| other.address == axis.address).count() > 1;
        match name.as_str() {
            "" => None,
            name if is_shared => Some(format!("{name}/{}", axis.node_axis)),
            name => Some(name.to_owned()),
        }
    };
    Ok(axes.iter().map(name).collect())
}

/// Reads the CANopen nodes of a configuration with their device files, in the order of the file, for
/// [`Network::boot`](ecan_canopen::Network::boot). Names are resolved, and the network is checked as a
/// whole. Empty without nodes. Nodes with an axis are left out: [`load_axes`] returns their axes,
/// with their identity, values and PDOs.
///
/// # Errors
/// [`ConfigFileError`]: the file cannot be read, or every fault of it, with line and column.
pub fn load_nodes(path: impl AsRef<Path>) -> Result<Vec<NodeDescription>, ConfigFileError> {
    let Bus { nodes, network, .. } = load_bus(path.as_ref())?;
    let nodes = nodes.into_iter().filter(|node| !node.has_axis).map(|node| node.node.description);
    Ok(nodes.map(|node| network.complete(node)).collect())
}

/// Reads the whole CANopen network of a configuration: all nodes, those with an axis too, in the order
/// of the file, then the axes without a node. The process data of axes are among the PDOs. For tools
/// that select a node by its name, and for
/// [`NetworkDescription::check`], which has found no fault.
///
/// # Errors
/// [`ConfigFileError`]: the file cannot be read, or every fault of it, with line and column.
pub fn load_network(path: impl AsRef<Path>) -> Result<NetworkDescription, ConfigFileError> {
    let Bus { config, network, nodes, axes, .. } = load_bus(path.as_ref())?;
    Ok(node::network(&config, &network, &nodes, &axes))
}

/// Reads the settings of the CANopen network of a configuration: SYNC, TIME, heartbeat of the host, and
/// what else the table `[network]` has; the master of a `[[bus]]` gives what the table does not state.
///
/// # Errors
/// [`ConfigFileError`]: the file cannot be read, or every fault of it, with line and column.
pub fn load_network_settings(path: impl AsRef<Path>) -> Result<NetworkSettings, ConfigFileError> {
    Ok(load_bus(path.as_ref())?.network)
}

/// Reads the device profiles that a configuration includes, with the effects of their values, in the
/// order of the gateways. Empty without profiles.
///
/// # Errors
/// [`ConfigFileError`]: the file cannot be read, or every fault of it, with line and column.
pub fn load_profiles(path: impl AsRef<Path>) -> Result<Vec<IncludedProfile>, ConfigFileError> {
    Ok(load_bus(path.as_ref())?.profiles)
}

/// Reads the settings of the service of `ecan serve`.
///
/// # Errors
/// [`ConfigFileError`]: the file cannot be read, or every fault of it, with line and column.
pub fn load_service(path: impl AsRef<Path>) -> Result<ServiceSettings, ConfigFileError> {
    Ok(load_bus(path.as_ref())?.service)
}

fn load_bus(path: &Path) -> Result<Bus, ConfigFileError> {
    let base = path.parent().unwrap_or(Path::new(""));
    load_by(path, |bytes| read(bytes, Includes::Directory(base.to_owned())))
}
