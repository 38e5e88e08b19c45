//! A node as a file describes it, before its names are resolved.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use ecan_canopen::{
    BootConfig, BootReset, ConfigurationDate, DeviceFile, GuardingConfig, IdentityCheck, NodeId,
    ParameterSet, PdoDirection,
};
use ecan_protocol::text::Printable;

use crate::config_file::document::Table;
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

/// Declares the settings of a node once: field with its type, key in a file and form of the value. An axis without a
/// node has those that are marked with `network`, too.
macro_rules! node_settings {
    ($(
        $(#[$attribute:meta])*
        $field:ident: $type:ty = $key:literal, $form:ident $argument:tt $($network:ident)?;
    )*) => {
        /// Settings of a node that its file states; `None` is the default of the boot-up.
        #[derive(Clone, Debug, Default)]
        pub(crate) struct NodeSettings {
            $($(#[$attribute])* pub(crate) $field: Option<$type>,)*
            /// Location of the guard time.
            pub(crate) guard_time_at: usize,
        }

        impl NodeSettings {
            /// Reads the settings of a node.
            pub(crate) fn read(table: &mut Table<'_, '_>) -> Self {
                Self {
                    $($field: node_settings!(@read table $form $key $argument),)*
                    guard_time_at: table.location("guard_time_ms"),
                }
            }

            /// Reads the settings of an axis without a node.
            pub(crate) fn read_network(table: &mut Table<'_, '_>) -> Self {
                let mut settings = Self::default();
                $($(node_settings!(@$network settings.$field; table $form $key $argument);)?)*
                settings.guard_time_at = table.location("guard_time_ms");
                settings
            }
        }
    };
    (@network $target:expr; $table:ident $form:ident $key:literal $argument:tt) => {
        $target = node_settings!(@read $table $form $key $argument)
    };
    (@read $table:ident $form:ident $key:literal ()) => { $table.$form($key) };
    (@read $table:ident $form:ident $key:literal ($argument:expr)) => {
        $table.$form($key, $argument)
    };
}

node_settings! {
    is_mandatory: bool = "mandatory", flag();
    order: u8 = "order", unsigned((0, 255));
    reset: BootReset = "reset", word(&RESETS) network;
    boot_timeout_ms: u64 = "boot_timeout_ms", unsigned((1, 3_600_000)) network;
    checks_identity: bool = "check_identity", flag();
    device_type: u32 = "device_type", unsigned((0, u32::MAX));
    vendor_id: u32 = "vendor_id", unsigned((0, u32::MAX));
    product_code: u32 = "product_code", unsigned((0, u32::MAX));
    revision: RevisionRule = "revision", word(&REVISIONS);
    revision_number: u32 = "revision_number", unsigned((0, u32::MAX));
    serial_number: u32 = "serial_number", unsigned((0, u32::MAX));
    software: u32 = "software", unsigned((0, u32::MAX));
    /// Subindex of 0x1011.
    restores: Option<u8> = "restore", word(&RESTORES);
    date: ConfigurationDate = "configuration_date", configuration_date();
    saves: bool = "save", flag();
    heartbeat_ms: u16 = "heartbeat_ms", unsigned((0, 0xFFFF)) network;
    guard_time_ms: u16 = "guard_time_ms", unsigned((1, 0xFFFF)) network;
    life_time_factor: u8 = "life_time_factor", unsigned((1, 0xFF)) network;
    starts: bool = "start", flag();
    reboots: bool = "reboot", flag();
}

const RESETS: [(&str, BootReset); 3] = [
    ("none", BootReset::None),
    ("communication", BootReset::Communication),
    ("node", BootReset::Node),
];
const REVISIONS: [(&str, RevisionRule); 3] = [
    ("any", RevisionRule::Any),
    ("compatible", RevisionRule::Compatible),
    ("exact", RevisionRule::Exact),
];
/// Subindices of 0x1011.
const RESTORES: [(&str, Option<u8>); 4] =
    [("none", None), ("all", Some(1)), ("communication", Some(2)), ("application", Some(3))];
/// Guarding requests without response that a node tolerates by default.
const LIFE_TIME_FACTOR: u8 = 3;

impl NodeSettings {
    pub(crate) fn boot_timeout(&self) -> Option<Duration> {
        self.boot_timeout_ms.map(Duration::from_millis)
    }

    pub(crate) fn guarding(&self) -> Option<GuardingConfig> {
        Some(Self::guarding_every(self.guard_time_ms?, self.life_time_factor))
    }

    pub(crate) fn guarding_every(ms: u16, life_time_factor: Option<u8>) -> GuardingConfig {
        let guard_time = Duration::from_millis(ms.into());
        let life_time_factor = life_time_factor.unwrap_or(LIFE_TIME_FACTOR);
        GuardingConfig { guard_time, life_time_factor }
    }

    /// Fault of a node that both sends a heartbeat and is guarded.
    pub(crate) fn guarding_fault(&self) -> Option<&'static str> {
        let is_both = self.guard_time_ms.is_some() && self.heartbeat_ms.is_some_and(|ms| ms > 0);
        is_both.then_some(
            "`guard_time_ms` and `heartbeat_ms` exclude each other; set `heartbeat_ms` = 0",
        )
    }

    /// The boot-up of a node with these settings.
    pub(crate) fn boot_config(&self, name: &str, identity: IdentityCheck) -> BootConfig {
        let default = BootConfig::default();
        BootConfig {
            name: name.into(),
            is_mandatory: self.is_mandatory.unwrap_or(default.is_mandatory),
            order: self.order.unwrap_or(default.order),
            reset: self.reset.unwrap_or(default.reset),
            boot_timeout: self.boot_timeout().unwrap_or(default.boot_timeout),
            identity,
            software: self.software,
            restores: self.restores.flatten(),
            parameters: Arc::new(ParameterSet {
                parameters: Vec::new(),
                date: self.date,
                saves: self.saves.unwrap_or(false),
            }),
            heartbeat_ms: self.heartbeat_ms.unwrap_or(default.heartbeat_ms),
            guarding: self.guarding(),
            starts: self.starts.unwrap_or(default.starts),
            reboots: self.reboots.unwrap_or(default.reboots),
            steps: default.steps,
        }
    }
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
    pub(crate) settings: NodeSettings,
    pub(crate) parameters: Vec<ParameterSource>,
    pub(crate) pdos: Vec<PdoSource>,
    /// The node watches the heartbeat of the master (bus.yml).
    pub(crate) watches_master: Option<Located<bool>>,
    /// Keys of its axis (bus.yml).
    pub(crate) ros_axis: RosAxis,
    /// What its file states and is not used.
    pub(crate) notes: Vec<String>,
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
            settings: NodeSettings::default(),
            parameters: Vec::new(),
            pdos: Vec::new(),
            watches_master: None,
            ros_axis: RosAxis::default(),
            notes: Vec::new(),
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
