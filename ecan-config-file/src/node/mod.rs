//! CANopen nodes of a file: `[[node]]`, and `[[bus]]` with the file of a bus.

mod bus_yml;
mod check;
mod device_files;
mod resolve;
mod source;
mod table;

use std::io;
use std::path::Path;
use std::rc::Rc;

use ecan_canopen::{BootConfig, BootReset, NodeDescription};
use ecan_cia402::{AxisConfig, DriveConfig, NodeReset};
use ecan_protocol::mapping::CHANNELS;

use crate::axis;
use crate::document::{Includes, Table};
use crate::fault::FileFaults;
use crate::text_lines::TextLines;
use device_files::DeviceFiles;
use resolve::{ResolvedNode, resolve};

pub(crate) use check::{check, network};

/// A node of a file, and the locations of its parts.
pub(crate) struct FileNode {
    pub(crate) node: ResolvedNode,
    /// The file of its bus, if its locations are in there.
    pub(crate) bus: Option<Rc<BusFile>>,
    /// The axis table configures it.
    pub(crate) has_axis: bool,
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
    axes: &mut Vec<Option<AxisConfig>>,
) -> Vec<FileNode> {
    let includes = root.includes();
    // A configuration that another program has sent has no device files: gateways do not need them.
    let can_read = !matches!(includes, Includes::Texts(_));
    let mut files = DeviceFiles::new(Box::new(|path| included(includes, path)));
    let mut nodes = Vec::new();
    for mut table in root.tables("node") {
        let source = table::read(&mut table);
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
        let address = node.as_ref().map(|it| it.description.address);
        let own = table.one_or_more("axis").into_iter();
        let mut own: Vec<_> = own.map(|axis| axis::read_at(axis, address)).collect();
        if let (Some(node), Some(Some(axis))) = (&node, own.first_mut()) {
            // An invalid PDO or value is a fault of the check.
            if let Ok(boot) = node.description.boot_config() {
                configure_drive(&mut axis.drive, boot);
            }
        }
        let has_axis = !own.is_empty();
        axes.extend(own);
        nodes.extend(node.map(|node| FileNode { node, bus: None, has_axis }));
    }
    for table in root.tables("bus") {
        nodes.extend(read_bus(table, &mut files, can_read));
    }
    nodes
}

/// The axis configures its drive as the boot-up of the node would.
fn configure_drive(drive: &mut DriveConfig, boot: BootConfig) {
    drive.reset = match boot.reset {
        BootReset::None => NodeReset::None,
        BootReset::Communication => NodeReset::Communication,
        BootReset::Node => NodeReset::Node,
    };
    drive.boot_timeout = boot.boot_timeout;
    drive.identity = boot.identity;
    drive.heartbeat_ms = boot.heartbeat_ms;
    drive.parameters = boot.parameters;
    drive.further.extend(boot.steps);
}

fn included(includes: &Includes, path: &Path) -> Result<Vec<u8>, String> {
    match includes {
        Includes::Directory(base) => crate::bytes(&base.join(path))
            .map_err(|error| format!("cannot read {}: {error}", path.display())),
        Includes::None | Includes::Texts(_) => Err(format!(
            "{} is relative to the configuration file: load the configuration from a file",
            path.display()
        )),
    }
}

/// Reads the file of a bus. Its faults are those of the key.
fn read_bus(
    mut table: Table<'_, '_>,
    files: &mut DeviceFiles<'_>,
    can_read: bool,
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
    match read_bus_text(&bus.text, (slave as usize, channel), directory, files) {
        Ok((nodes, faults)) => {
            for (at, reason) in faults {
                let (at, reason) = bus.fault(at, &reason);
                table.fault_at(at, reason);
            }
            let nodes = nodes.into_iter();
            nodes
                .map(|node| FileNode { node, bus: Some(Rc::clone(&bus)), has_axis: false })
                .collect()
        }
        Err(faults) => {
            for fault in faults.0 {
                table.fault("file", format!("`file` {name}: {fault}"));
            }
            Vec::new()
        }
    }
}

/// Faults with their locations.
type LocatedFaults = Vec<(usize, String)>;

/// Reads the nodes of a bus whose device files are in a directory.
fn read_bus_text(
    text: &str,
    (slave, channel): (usize, u8),
    directory: &Path,
    files: &mut DeviceFiles<'_>,
) -> Result<(Vec<ResolvedNode>, LocatedFaults), FileFaults> {
    let (_, sources) = bus_yml::read(text, slave, channel)?;
    let (mut nodes, mut faults) = (Vec::new(), Vec::new());
    for source in sources {
        let Some(file) = &source.device_file else { continue };
        match files.device(&directory.join(&file.value)) {
            Ok(device) => {
                let mut report = |at, reason| faults.push((at, reason));
                nodes.extend(resolve(&source, Some(device), &mut report));
            }
            Err(reason) => faults.push((file.at, reason)),
        }
    }
    Ok((nodes, faults))
}

/// Reads the nodes of a file in the form of ros2_canopen, whose bus is a channel of a slave. `read`
/// returns the bytes of a device file, by its name in the text. Names are resolved; the network is
/// not checked, see [`NetworkDescription::check`](ecan_canopen::NetworkDescription::check).
///
/// # Errors
/// Every fault, with line and column.
pub fn parse_bus_yml(
    text: &str,
    bus: (usize, u8),
    mut read: impl FnMut(&Path) -> io::Result<Vec<u8>>,
) -> Result<Vec<NodeDescription>, FileFaults> {
    let mut files = DeviceFiles::new(Box::new(move |path: &Path| {
        read(path).map_err(|error| format!("cannot read {}: {error}", path.display()))
    }));
    let (nodes, faults) = read_bus_text(text, bus, Path::new(""), &mut files)?;
    TextLines::new(text).finish(faults)?;
    Ok(nodes.into_iter().map(|node| node.description).collect())
}
