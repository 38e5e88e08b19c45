//! Reads a configuration file, or its parts, and checks the whole.

use std::collections::BTreeMap;
use std::path::Path;

use ecan_canopen::{NetworkDescription, NodeDescription};
use ecan_cia402::AxisConfig;
use ecan_host::{ConfigFault, Expectation, PlanError, StartupStep};
use ecan_mcan_port::{Config, PortConfigFault, PortPlanError};
use ecan_protocol::can::{BitTimingError, MCAN_CLOCK_HZ, Phase, solve_bit_timing};
use ecan_protocol::config::{
    ChannelFault, ConfigObject, DataPathFault, DataPathGlobal, DeviceConfig, DeviceFault,
    DiagnosticTest, FilterElementFault, FilterFault, RangeFault,
};
use ecan_protocol::image::ProfileError;
use ecan_protocol::mapping::Direction;
use ecan_protocol::object::lookup;

use super::bus::{Bus, ServiceSettings};
use super::device_profile::IncludedProfile;
use super::document::{Document, Includes, Table, load_by};
use super::fault::{ConfigFileError, FileFaults};
use super::gateway::{CHANNEL_TABLES, EXTENDED_TABLE, STANDARD_TABLE};
use super::network::NetworkSettings;
use super::node::FileNode;
use super::{axis, bus, node};
use crate::EcrtOptions;

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
            check(document, &bus.config);
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
    let Bus { axes, nodes, .. } = load_bus(path.as_ref())?;
    log_notes(nodes.iter().filter(|node| node.has_axis));
    Ok(axes.into_iter().flatten().map(|axis| axis.config).collect())
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
    let Bus { mut nodes, network, .. } = load_bus(path.as_ref())?;
    nodes.retain(|node| !node.has_axis);
    log_notes(nodes.iter());
    Ok(nodes.into_iter().map(|node| network.complete(node.node.description)).collect())
}

/// Reads what the device files make different from the usual boot-up of the nodes: objects that are left out because a
/// device does not have them, statements that contradict each other. [`load_nodes`] and [`load_axes`] log it.
///
/// # Errors
/// [`ConfigFileError`]: the file cannot be read, or every fault of it, with line and column.
pub fn load_notes(path: impl AsRef<Path>) -> Result<Vec<String>, ConfigFileError> {
    Ok(load_bus(path.as_ref())?.nodes.iter().flat_map(FileNode::notes).collect())
}

fn log_notes<'n>(nodes: impl Iterator<Item = &'n FileNode>) {
    nodes.flat_map(FileNode::notes).for_each(|note| tracing::warn!("{note}"));
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

/// Reads with which options a plain `sim` has the gateways of a configuration, and its nodes and axes with
/// their device files.
///
/// # Errors
/// [`ConfigFileError`]: the file cannot be read, or every fault of it, with line and column.
pub fn load_ecrt_options(path: impl AsRef<Path>) -> Result<EcrtOptions, ConfigFileError> {
    let path = path.as_ref();
    let Bus { config, nodes, axes, .. } = load_bus(path)?;
    let axes: Vec<AxisConfig> = axes.into_iter().flatten().map(|axis| axis.config).collect();
    let mut options = EcrtOptions::for_axes(&config.adapter, &axes);
    let directory = path.parent().unwrap_or(Path::new(""));
    for FileNode { node, .. } in &nodes {
        let file = node.device_file.as_ref().map(|file| directory.join(file));
        options.add_node(&config.adapter, node.description.address, 1, file);
    }
    Ok(options)
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

/// Checks the configuration and reports its faults to the document.
fn check(document: &Document<'_>, file: &Config) {
    let Err(faults) = file.port.check(&file.adapter) else { return };
    for fault in faults.0 {
        document.semantic_fault(&locations(&fault), fault.to_string());
        if let Some(hidden) = hidden_by(file, &fault) {
            document.semantic_fault(&locations(&hidden), hidden.to_string());
        }
    }
}

/// The fault of a bit rate without a timing that an invalid sample point window hides.
fn hidden_by(file: &Config, fault: &PortConfigFault) -> Option<PortConfigFault> {
    let PortConfigFault::Channel { slave, channel, fault } = *fault else { return None };
    let ChannelFault::Timing { phase, error: BitTimingError::Window { .. } } = fault else {
        return None;
    };
    let gateway = file.port.gateways.get(slave)?;
    let can = &gateway.channels.get(usize::from(channel))?.as_ref()?.can;
    let bitrate = match phase {
        Phase::Nominal => can.nominal_bitrate,
        Phase::Data => can.data_bitrate,
    };
    let error = solve_bit_timing(phase, MCAN_CLOCK_HZ, bitrate, 0, 1_000).err()?;
    let fault = ChannelFault::Timing { phase, error };
    Some(PortConfigFault::Channel { slave, channel, fault })
}

fn gateway(slave: usize) -> String {
    format!("gateway[{slave}]")
}

fn in_channel(slave: usize, channel: u8, keys: &[&str]) -> Vec<String> {
    let table = CHANNEL_TABLES.get(usize::from(channel)).copied().unwrap_or("can0");
    let table = format!("{}.{table}", gateway(slave));
    keys.iter().map(|key| format!("{table}.{key}")).collect()
}

fn in_direction(slave: usize, pdo: &str, key: &str) -> Vec<String> {
    let gateway = gateway(slave);
    let table = if pdo == "TxPDO" { "tx_pdo" } else { "rx_pdo" };
    vec![format!("{gateway}.{table}.{key}"), format!("{gateway}.{key}")]
}

/// Keys that a fault may come from, the most likely one first.
fn locations(fault: &PortConfigFault) -> Vec<String> {
    let one = |path: String| vec![path];
    match *fault {
        PortConfigFault::Adapter(fault) => adapter_locations(&fault),
        PortConfigFault::NoChannel { slave } => one(gateway(slave)),
        PortConfigFault::Profile { slave, direction, fault } => {
            let key = match fault {
                ProfileError::Multiplier(_) => "n",
                ProfileError::ChannelMask(_) => "channels",
                _ => "options",
            };
            in_direction(slave, pdo(direction), key)
        }
        PortConfigFault::MaskBeyondChannels { slave, direction, .. } => {
            in_direction(slave, pdo(direction), "channels")
        }
        PortConfigFault::ChannelInNoMask { slave, channel } => in_channel(slave, channel, &[""]),
        PortConfigFault::Bypass { slave, direction } => {
            in_direction(slave, pdo(direction), "options")
        }
        PortConfigFault::Device { slave, fault } => device_locations(slave, fault),
        PortConfigFault::DiagnosticTest { slave } => {
            one(format!("{}.diagnostic_test", gateway(slave)))
        }
        PortConfigFault::Channel { slave, channel, fault } => {
            channel_locations(slave, channel, fault)
        }
        PortConfigFault::DataPath { slave, channel, fault } => match fault {
            DataPathFault::Range(RangeFault { index, subindex, .. }) => {
                let key = key_of(index, subindex).unwrap_or("enable");
                in_channel(slave, channel, &[&format!("data_path.{key}")])
            }
            DataPathFault::RxBudget { .. } => {
                in_channel(slave, channel, &["data_path.rx_drain_min", "data_path.rx_drain_max"])
            }
            DataPathFault::TxBudget { .. } => {
                in_channel(slave, channel, &["data_path.tx_budget_min", "data_path.tx_budget_max"])
            }
        },
        PortConfigFault::Plan(error) => match error {
            PortPlanError::EtherCat(error) => plan_locations(&error),
            PortPlanError::Budget { slave, channel, .. } => {
                in_channel(slave, channel, &["traffic"])
            }
            _ => Vec::new(),
        },
        PortConfigFault::Filter { slave, channel, fault } => {
            filter_locations(slave, channel, &fault)
        }
        PortConfigFault::HoldLimit { slave } => one(format!("{}.hold_limit", gateway(slave))),
        _ => Vec::new(),
    }
}

fn key_of(index: u16, subindex: u8) -> Option<&'static str> {
    lookup(index, subindex)?.1.key
}

/// Key of the fault's entry, then the table of its object.
fn device_locations(slave: usize, fault: DeviceFault) -> Vec<String> {
    let (index, subindex) = match fault {
        DeviceFault::Range(fault) | DeviceFault::DataPath(DataPathFault::Range(fault)) => {
            (fault.index, fault.subindex)
        }
        DeviceFault::DataPath(_) => (DataPathGlobal::INDEX, 0),
        DeviceFault::Test(_) => (DiagnosticTest::INDEX, 1),
    };
    let table = DeviceConfig::OBJECTS.into_iter().find(|(object, _)| *object == index);
    let table = format!("{}.{}", gateway(slave), table.map_or("", |(_, table)| table));
    vec![format!("{table}.{}", key_of(index, subindex).unwrap_or_default()), table]
}

fn pdo(direction: Direction) -> &'static str {
    match direction {
        Direction::TxPdo => "TxPDO",
        Direction::RxPdo => "RxPDO",
    }
}

fn adapter_locations(fault: &ConfigFault) -> Vec<String> {
    let one = |path: &str| vec![path.to_owned()];
    match *fault {
        ConfigFault::SameAddress { second, .. } => {
            let gateway = gateway(second);
            vec![format!("{gateway}.position"), format!("{gateway}.alias"), gateway]
        }
        ConfigFault::Multiplier { slave, pdo, .. } => in_direction(slave, pdo, "n"),
        ConfigFault::Cycle { .. } => one("cycle_us"),
        ConfigFault::WatchdogTime { .. } => one("watchdog_us"),
        ConfigFault::Plan(error) => plan_locations(&error),
        ConfigFault::Sync0Cycle { .. } => one("dc.cycle_us"),
        ConfigFault::Sync0Shift { .. } => one("dc.shift_us"),
        ConfigFault::ReferenceClock { .. } => one("dc.reference"),
        ConfigFault::Identity { slave } => vec![format!("{}.identity", gateway(slave))],
        _ => Vec::new(),
    }
}

fn plan_locations(error: &PlanError) -> Vec<String> {
    match *error {
        PlanError::LargePdo { slave, pdo, .. } => in_direction(slave, pdo, "n"),
        PlanError::Watchdog { .. } => vec!["watchdog_us".to_owned(), "cycle_us".to_owned()],
        _ => vec!["cycle_us".to_owned()],
    }
}

fn channel_locations(slave: usize, channel: u8, fault: ChannelFault) -> Vec<String> {
    let phase_keys = |phase, [nominal, data]: [&[&str]; 2]| match phase {
        Phase::Nominal => in_channel(slave, channel, nominal),
        Phase::Data => in_channel(slave, channel, data),
    };
    match fault {
        ChannelFault::Range(RangeFault { index, subindex, .. }) => {
            in_channel(slave, channel, &[key_of(index, subindex).unwrap_or("bitrate")])
        }
        ChannelFault::Timing { phase, error } => match error {
            BitTimingError::Window { .. } | BitTimingError::SamplePoint { .. } => phase_keys(
                phase,
                [&["sample_point", "bitrate"], &["data_sample_point", "data_bitrate"]],
            ),
            _ => phase_keys(phase, [&["bitrate"], &["data_bitrate"]]),
        },
        ChannelFault::ManualTiming { phase, .. } | ChannelFault::ManualBitrate { phase, .. } => {
            phase_keys(phase, [&["nominal_timing", "bit_timing"], &["data_timing", "bit_timing"]])
        }
        ChannelFault::DataBelowNominal { .. } => in_channel(slave, channel, &["data_bitrate"]),
        ChannelFault::TdcPrescaler { .. } => in_channel(slave, channel, &["tdc", "data_bitrate"]),
        ChannelFault::TransmitElements { .. } => {
            in_channel(slave, channel, &["ram.tx_dedicated_count", "ram.tx_fifo_size"])
        }
        ChannelFault::NoTransmitFifo => in_channel(slave, channel, &["ram.tx_fifo_size"]),
        ChannelFault::NonMatchWithoutFifo { fifo } => {
            let size = format!("ram.rx_fifo{fifo}_size");
            in_channel(slave, channel, &[&size, "non_match_standard", "non_match_extended"])
        }
        ChannelFault::MessageRam { .. } => in_channel(slave, channel, &["ram"]),
    }
}

fn filter_locations(slave: usize, channel: u8, fault: &FilterFault) -> Vec<String> {
    let (extended, at, key) = match *fault {
        FilterFault::TooMany { extended, max, .. } => (extended, usize::from(max), ""),
        FilterFault::Element { extended, at, fault } => {
            let key = match fault {
                FilterElementFault::Identifier { .. } => "id1",
                FilterElementFault::EmptyRange { .. } => "id2",
                FilterElementFault::NoBuffer { .. } => "rx_buffer",
                FilterElementFault::NoFifo { .. } => "action",
            };
            (extended, at, key)
        }
    };
    let table = if extended { EXTENDED_TABLE } else { STANDARD_TABLE };
    let table = format!("{table}[{at}]");
    in_channel(slave, channel, &[&format!("{table}.{key}"), &table])
}
