//! A node as a file describes it, before its names are resolved.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use ecan_canopen::{BootReset, ConfigurationDate, DeviceFile, NodeId, PdoDirection};
use ecan_protocol::text::Printable;

use crate::config_file::fault::Located;

/// How the revision number is compared with that of the device file.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) enum RevisionRule {
    #[default]
    Any,
    Compatible,
    Exact,
}

/// Index and subindex, or a name of the device file; and the value as text.
#[derive(Clone, Debug)]
pub(crate) struct ParameterSource {
    pub(crate) object: Located<String>,
    pub(crate) value: Located<String>,
}

/// A PDO.
#[derive(Clone, Debug)]
pub(crate) struct PdoSource {
    pub(crate) at: usize,
    pub(crate) direction: PdoDirection,
    pub(crate) number: u16,
    pub(crate) is_enabled: bool,
    /// `None` is that of the device file.
    pub(crate) cob_id: Option<Located<u16>>,
    /// The COB-ID is that of the predefined connection set.
    pub(crate) is_predefined: bool,
    /// `None` is that of the device file.
    pub(crate) transmission: Option<Located<u8>>,
    /// In units of 100 us.
    pub(crate) inhibit_time: Option<u16>,
    pub(crate) event_timer_ms: Option<u16>,
    pub(crate) sync_start: Option<u8>,
    /// `None` leaves the mapping of the device file.
    pub(crate) objects: Option<Vec<Located<String>>>,
}

impl PdoSource {
    pub(crate) fn new(at: usize, direction: PdoDirection, number: u16) -> Self {
        Self {
            at,
            direction,
            number,
            is_enabled: true,
            cob_id: None,
            is_predefined: false,
            transmission: None,
            inhibit_time: None,
            event_timer_ms: None,
            sync_start: None,
            objects: None,
        }
    }
}

/// The keys of a node in the form of ros2_canopen that concern its axis.
#[derive(Clone, Debug, Default)]
pub(crate) struct RosAxis {
    /// The driver is one of CiA 402.
    pub(crate) is_axis: bool,
    /// Of the position, velocity and torque interface.
    pub(crate) modes: [Option<Located<i8>>; 3],
    /// Units of the device per radian.
    pub(crate) position_units: Option<f64>,
    /// Position of the device at angle 0.
    pub(crate) origin: Option<f64>,
    /// Units of the device per radian per second.
    pub(crate) velocity_units: Option<f64>,
}

/// A node.
#[derive(Clone, Debug)]
pub(crate) struct NodeSource {
    pub(crate) at: usize,
    pub(crate) name: String,
    pub(crate) slave: usize,
    pub(crate) channel: u8,
    pub(crate) node: Option<Located<NodeId>>,
    pub(crate) device_file: Option<Located<PathBuf>>,
    pub(crate) is_mandatory: Option<bool>,
    pub(crate) order: Option<u8>,
    pub(crate) reset: Option<BootReset>,
    pub(crate) boot_timeout_ms: Option<u64>,
    pub(crate) checks_identity: bool,
    pub(crate) device_type: Option<u32>,
    pub(crate) vendor_id: Option<u32>,
    pub(crate) product_code: Option<u32>,
    pub(crate) revision: RevisionRule,
    pub(crate) revision_number: Option<u32>,
    pub(crate) serial_number: Option<u32>,
    pub(crate) software: Option<u32>,
    /// Subindex of 0x1011.
    pub(crate) restores: Option<u8>,
    pub(crate) date: Option<ConfigurationDate>,
    pub(crate) saves: Option<bool>,
    pub(crate) heartbeat_ms: Option<u16>,
    pub(crate) guard_time_ms: Option<Located<u16>>,
    pub(crate) life_time_factor: Option<u8>,
    pub(crate) starts: Option<bool>,
    pub(crate) reboots: Option<bool>,
    pub(crate) parameters: Vec<ParameterSource>,
    pub(crate) pdos: Vec<PdoSource>,
    /// The node watches the heartbeat of the master (bus.yml).
    pub(crate) watches_master: Option<Located<bool>>,
    /// Keys of its axis (bus.yml).
    pub(crate) ros_axis: RosAxis,
}

impl NodeSource {
    pub(crate) fn new(at: usize, slave: usize, channel: u8) -> Self {
        Self {
            at,
            name: String::new(),
            slave,
            channel,
            node: None,
            device_file: None,
            is_mandatory: None,
            order: None,
            reset: None,
            boot_timeout_ms: None,
            checks_identity: true,
            device_type: None,
            vendor_id: None,
            product_code: None,
            revision: RevisionRule::Any,
            revision_number: None,
            serial_number: None,
            software: None,
            restores: None,
            date: None,
            saves: None,
            heartbeat_ms: None,
            guard_time_ms: None,
            life_time_factor: None,
            starts: None,
            reboots: None,
            parameters: Vec::new(),
            pdos: Vec::new(),
            watches_master: None,
            ros_axis: RosAxis::default(),
        }
    }
}

/// Returns the bytes of a file with this path in the configuration, or a reason.
pub(crate) type ReadFile<'r> = dyn FnMut(&Path) -> Result<Vec<u8>, String> + 'r;

pub(crate) struct DeviceFiles<'r> {
    read: Box<ReadFile<'r>>,
    /// `None` for one that cannot be used; its faults are reported once.
    devices: BTreeMap<PathBuf, Option<Arc<DeviceFile>>>,
}

impl<'r> DeviceFiles<'r> {
    pub(crate) fn new(read: Box<ReadFile<'r>>) -> Self {
        Self { read, devices: BTreeMap::new() }
    }

    /// The device file with this path in the configuration.
    pub(crate) fn device(&mut self, path: &Path) -> Result<Arc<DeviceFile>, String> {
        if let Some(known) = self.devices.get(path) {
            return known
                .clone()
                .ok_or_else(|| format!("{}: see above", Printable(path.display())));
        }
        let read = (self.read)(path).and_then(|bytes| {
            DeviceFile::parse(&bytes)
                .map_err(|faults| format!("{}: {faults}", Printable(path.display())))
        });
        let device = read.map(Arc::new);
        self.devices.insert(path.to_owned(), device.as_ref().ok().cloned());
        device
    }

    /// The text with this path in the configuration.
    pub(crate) fn text(&mut self, path: &Path) -> Result<String, String> {
        let bytes = (self.read)(path)?;
        String::from_utf8(bytes)
            .map_err(|error| format!("{}: not UTF-8: {error}", Printable(path.display())))
    }
}
