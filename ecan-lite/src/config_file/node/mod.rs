//! CANopen nodes of a file: `[[node]]`, and `[[bus]]` with the file of a bus.

use std::io;
use std::path::Path;
use std::rc::Rc;
use std::sync::Arc;

pub(crate) use check::{check, network};
use ecan_canopen::{
    BootConfig, HeartbeatConsumer, HostHeartbeat, NodeDescription, NodeId, PdoDirection, object,
};
use ecan_cia402::{AxisConfig, DriveConfig};
use ecan_protocol::mapping::CHANNELS;
use ecan_protocol::text::Printable;
use resolve::{ResolvedNode, resolve};
pub(super) use source::NodeSettings;
use source::{DeviceFiles, NodeSource, ParameterSource, PdoSource};

use super::axis;
use super::axis::FileAxis;
use super::document::{Includes, Table};
use super::fault::{FileFaults, Located, TextLines};
use super::network::NetworkTable;

mod bus_yml;
mod check;
mod resolve;
mod source;

/// A node of a file, and the locations of its parts.
pub(crate) struct FileNode {
    pub(crate) node: ResolvedNode,
    /// The file of its bus, if its locations are in there.
    pub(crate) bus: Option<Rc<BusFile>>,
    /// The axis table configures it.
    pub(crate) has_axis: bool,
}

impl FileNode {
    /// What the device file makes different, with the name of the node.
    pub(crate) fn notes(&self) -> impl Iterator<Item = String> {
        let ResolvedNode { description, notes, .. } = &self.node;
        notes.iter().map(|note| format!("{}: {note}", description.title()))
    }
}

/// The file of a bus.
pub(crate) struct BusFile {
    pub(crate) name: String,
    pub(crate) text: String,
    /// Location of its name in the configuration.
    pub(crate) at: usize,
}

impl BusFile {
    /// Location and text of a fault of this file in the configuration.
    pub(crate) fn fault(&self, at: usize, reason: &str) -> (usize, String) {
        let (line, column) = TextLines::new(&self.text).line_and_column(at);
        (self.at, format!("`file` {}: line {line}, column {column}: {reason}", self.name))
    }
}

/// Reads the nodes; those with an axis add it to `axes`.
pub(crate) fn read_all(
    root: &mut Table<'_, '_>,
    axes: &mut Vec<Option<FileAxis>>,
    network: &mut NetworkTable,
    cycle_ns: u32,
) -> Vec<FileNode> {
    let includes = root.includes();
    // A configuration that another program has sent has no device files: gateways do not need them.
    let can_read = !matches!(includes, Includes::Texts(_));
    let mut files = DeviceFiles::new(Box::new(|path| included(includes, path)));
    let mut nodes = Vec::new();
    for mut table in root.tables("node") {
        let source = read(&mut table);
        let device = source.device_file.as_ref().filter(|_| can_read).and_then(|path| {
            let device = files.device(&path.value);
            device.map_err(|reason| table.fault_at(path.at, reason)).ok()
        });
        // A device file that cannot be read would cause a fault of every name.
        let is_unreadable = source.device_file.is_some() && device.is_none();
        let node = resolve(&source, device, &mut |at, reason| {
            if !is_unreadable {
                table.fault_at(at, reason);
            }
        });
        let address = node.as_ref().map(|node| node.description.address);
        let own = table.one_or_more("axis").into_iter().zip(0..=u8::MAX);
        let mut own: Vec<_> = own.map(|(axis, nth)| axis::read_at(axis, address, nth)).collect();
        // An invalid PDO or value is a fault of the check.
        if let Some(mut boot) = node.as_ref().and_then(|node| node.description.boot_config().ok()) {
            for axis in own.iter_mut().flatten() {
                configure_drive(&mut axis.config.drive, &boot);
                // Once for the node.
                boot.steps.clear();
            }
        }
        let has_axis = !own.is_empty();
        axes.extend(own);
        nodes.extend(node.map(|node| FileNode { node, bus: None, has_axis }));
    }
    for table in root.tables("bus") {
        nodes.extend(read_bus(table, &mut files, can_read, axes, (network, cycle_ns)));
    }
    nodes
}

/// The axis configures its drive as the boot-up of the node would.
fn configure_drive(drive: &mut DriveConfig, boot: &BootConfig) {
    drive.reset = axis::node_reset(boot.reset);
    drive.boot_timeout = boot.boot_timeout;
    drive.identity = boot.identity;
    drive.heartbeat_ms = boot.heartbeat_ms;
    drive.guarding = boot.guarding;
    drive.parameters = Arc::clone(&boot.parameters);
    drive.further.extend(&boot.steps);
}

fn included(includes: &Includes, path: &Path) -> Result<Vec<u8>, String> {
    match includes {
        Includes::Directory(base) => crate::config_file::read_bytes(base.join(path))
            .map_err(|error| format!("cannot read {}: {error}", Printable(path.display()))),
        Includes::None | Includes::Texts(_) => Err(format!(
            "{} is relative to the configuration file: load the configuration from a file",
            Printable(path.display())
        )),
    }
}

/// Reads the file of a bus. Its faults are those of the key.
fn read_bus(
    mut table: Table<'_, '_>,
    files: &mut DeviceFiles<'_>,
    can_read: bool,
    axes: &mut Vec<Option<FileAxis>>,
    (network, cycle_ns): (&mut NetworkTable, u32),
) -> Vec<FileNode> {
    let slave = table.required("gateway", "the index of its gateway in the file", (0, 0xFFFF));
    let channel = table.required("channel", "0 to 3", (0, CHANNELS as u32 - 1));
    let name = table.text("file");
    if name.is_none() && !table.has("file") {
        table.fault("file", "`file` is missing: the path of a bus.yml");
    }
    let Some(((slave, channel), name)) = slave.zip(channel).zip(name) else { return Vec::new() };
    if !can_read {
        return Vec::new();
    }
    let text = match files.text(Path::new(name)) {
        Ok(text) => text,
        Err(reason) => {
            table.fault("file", reason);
            return Vec::new();
        }
    };
    let bus = Rc::new(BusFile { name: name.to_owned(), text, at: table.location("file") });
    let channel = u8::try_from(channel).unwrap_or(0);
    let directory = Path::new(name).parent().unwrap_or(Path::new(""));
    let read = read_bus_text(
        &bus.text,
        (slave as usize, channel),
        directory,
        files,
        (network, Some(cycle_ns)),
    );
    let (read, faults) = match read {
        Ok(read) => read,
        Err(faults) => {
            for fault in faults.0 {
                table.fault("file", format!("`file` {name}: {fault}"));
            }
            return Vec::new();
        }
    };
    for (at, reason) in faults {
        let (at, reason) = bus.fault(at, &reason);
        table.fault_at(at, reason);
    }
    let mut nodes = Vec::new();
    for BusNode { mut node, axis } in read {
        let has_axis = axis.is_some();
        if let Some(mut axis) = axis {
            // The axis maps its PDOs.
            node.description.pdos.clear();
            node.description.disabled_pdos.clear();
            node.pdos.clear();
            // An invalid PDO or value is a fault of the check.
            if let Ok(boot) = node.description.boot_config() {
                configure_drive(&mut axis.drive, &boot);
            }
            axes.push(Some(FileAxis { config: axis, path: table.path("file") }));
        }
        nodes.push(FileNode { node, bus: Some(Rc::clone(&bus)), has_axis });
    }
    nodes
}

/// Faults with their locations.
type LocatedFaults = Vec<(usize, String)>;

/// A node of a bus, with its axis if the driver is one of CiA 402.
struct BusNode {
    node: ResolvedNode,
    axis: Option<AxisConfig>,
}

/// Reads the nodes of a bus whose device files are in a directory, and its master.
fn read_bus_text(
    text: &str,
    (slave, channel): (usize, u8),
    directory: &Path,
    files: &mut DeviceFiles<'_>,
    (network, cycle_ns): (&mut NetworkTable, Option<u32>),
) -> Result<(Vec<BusNode>, LocatedFaults), FileFaults> {
    let (master, sources) = bus_yml::read(text, slave, channel)?;
    let (mut nodes, mut faults) = (Vec::new(), Vec::new());
    let mut report = |at, reason| faults.push((at, reason));
    network.add_master(&master, cycle_ns, &mut report);
    let host = network.settings.cia402.network.host_heartbeat;
    for mut source in sources {
        let Some(file) = &source.device_file else { continue };
        let device = match files.device(&directory.join(&file.value)) {
            Ok(device) => device,
            Err(reason) => {
                report(file.at, reason);
                continue;
            }
        };
        let time_ms = watch_master(&mut source, host, master.heartbeat_multiplier);
        let Some(node) = resolve(&source, Some(device), &mut report) else { continue };
        let axis = source
            .ros_axis
            .is_axis
            .then(|| bus_yml::axis(&source.ros_axis, time_ms, &node, &mut report));
        nodes.push(BusNode { node, axis });
    }
    Ok((nodes, faults))
}

/// Lets a node watch the heartbeat of the host (0x1016) if its file states that; returns the time in
/// milliseconds, 0 if it does not.
fn watch_master(
    source: &mut NodeSource,
    host: Option<HostHeartbeat>,
    multiplier: Option<f64>,
) -> Option<u16> {
    let watches = source.watches_master.as_ref()?;
    let (Some(host), true) = (host, watches.value) else { return Some(0) };
    let time_ms = bus_yml::consumer_time_ms(host, multiplier);
    if !source.ros_axis.is_axis {
        let entry = HeartbeatConsumer { producer: host.node, time_ms };
        source.parameters.push(ParameterSource {
            object: Located::new(format!("0x{:04X}:1", object::CONSUMER_HEARTBEAT), watches.at),
            value: Located::new(entry.raw().to_string(), watches.at),
        });
    }
    Some(time_ms)
}

/// Reads the nodes of a file in the form of ros2_canopen, whose bus is a channel of a slave. `read`
/// returns the bytes of a device file, by its name in the text. Names are resolved; the network is
/// not checked, see [`NetworkDescription::check`](ecan_canopen::NetworkDescription::check). Nodes with
/// a driver of CiA 402 are described like the others.
///
/// # Errors
/// Every fault, with line and column.
pub fn parse_bus_yml(
    text: &str,
    bus: (usize, u8),
    mut read: impl FnMut(&Path) -> io::Result<Vec<u8>>,
) -> Result<Vec<NodeDescription>, FileFaults> {
    let mut files = DeviceFiles::new(Box::new(move |path: &Path| {
        read(path).map_err(|error| format!("cannot read {}: {error}", Printable(path.display())))
    }));
    let mut network = NetworkTable::default();
    let (nodes, faults) =
        read_bus_text(text, bus, Path::new(""), &mut files, (&mut network, None))?;
    TextLines::new(text).finish(faults)?;
    Ok(nodes.into_iter().map(|node| node.node.description).collect())
}

const PDOS: [(&str, PdoDirection); 2] =
    [("rpdo", PdoDirection::Receive), ("tpdo", PdoDirection::Transmit)];
/// Reads a node. The tables of its axes remain for [`super::axis`].
pub(crate) fn read(table: &mut Table<'_, '_>) -> NodeSource {
    let slave = table.required("gateway", "the index of its gateway in the file", (0, 0xFFFF));
    let channel = table.required("channel", "0 to 3", (0, CHANNELS as u32 - 1));
    let mut source = NodeSource::new(
        table.at(),
        slave.unwrap_or(0) as usize,
        channel.and_then(|channel| u8::try_from(channel).ok()).unwrap_or(0),
    );
    source.name = table.text("name").unwrap_or_default().to_owned();
    let node = table.unsigned::<u8>("node", (1, 127)).and_then(NodeId::from_raw);
    source.node = node.map(|node| Located::new(node, table.location("node")));
    let file = table.text("device_file").map(Into::into);
    source.device_file = file.map(|file| Located::new(file, table.location("device_file")));
    source.settings = NodeSettings::read(table);
    if let Some(mut parameters) = table.table("parameters") {
        source.parameters = parameters
            .scalars()
            .into_iter()
            .map(|(key, at, value)| ParameterSource {
                object: Located::new(key, at),
                value: Located::new(value, at),
            })
            .collect();
    }
    for (key, direction) in PDOS {
        for pdo in table.tables(key) {
            source.pdos.push(read_pdo(pdo, direction));
        }
    }
    source
}

fn read_pdo(mut table: Table<'_, '_>, direction: PdoDirection) -> PdoSource {
    let number = table.required("number", "1 to 512", (1, 512));
    let cob_id = table.unsigned("cob_id", (1, 0x7FF));
    let transmission = table.unsigned("transmission", (0, 255));
    let number = number.and_then(|number| u16::try_from(number).ok()).unwrap_or(1);
    PdoSource {
        is_enabled: table.flag("enabled").unwrap_or(true),
        cob_id: cob_id.map(|id| Located::new(id, table.location("cob_id"))),
        transmission: transmission.map(|kind| Located::new(kind, table.location("transmission"))),
        inhibit_time: table.unsigned("inhibit_time_100us", (0, 0xFFFF)),
        event_timer_ms: table.unsigned("event_timer_ms", (0, 0xFFFF)),
        sync_start: table.unsigned("sync_start", (0, 240)),
        objects: table.texts("objects"),
        ..PdoSource::new(table.at(), direction, number)
    }
}
