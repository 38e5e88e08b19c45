use std::net::IpAddr;
use std::path::{Path, PathBuf};

use ecan_can_io::recording::ReadOptions;
use ecan_canopen::NodeId;
use serde::Deserialize;

use crate::drive::{DriveConfig, DriveQuirks, MotorConfig};
use crate::node::{BridgeProtocol, BridgeSpec, FaultyConfig};
use crate::scenario::file::raw_physical_layer::RawPhysicalLayer;
use crate::scenario::file::set;
use crate::scenario::{DriveSpec, NodeKind, NodeSpec, Scenario};

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawNode {
    kind: RawNodeKind,
    bus: String,
    name: Option<String>,
    bitrate: Option<u32>,
    data_bitrate: Option<u32>,
    sample_point: Option<f64>,
    data_sample_point: Option<f64>,
    tdc: Option<bool>,
    tdc_offset_ns: Option<u32>,
    cable_ns: Option<u32>,
    transceiver_ns: Option<u32>,
    file: Option<PathBuf>,
    format: Option<String>,
    time_stamps: Option<String>,
    drop_permille: Option<u16>,
    corrupt_permille: Option<u16>,
    repeat_permille: Option<u16>,
    babble_us: Option<u32>,
    protocol: Option<BridgeProtocol>,
    address: Option<IpAddr>,
    port: Option<u16>,
    max_clients: Option<usize>,
    queue: Option<usize>,
    node_id: Option<u8>,
    #[serde(alias = "dcf")]
    eds: Option<PathBuf>,
    serial: Option<u32>,
    axes: Option<u8>,
    boot_ms: Option<u32>,
    sdo_delay_us: Option<u32>,
    enable_ms: Option<u32>,
    motor: Option<MotorConfig>,
    quirks: Option<DriveQuirks>,
}

#[derive(Deserialize, Clone, Copy, Debug, PartialEq)]
#[serde(rename_all = "lowercase")]
enum RawNodeKind {
    Echo,
    Replay,
    Silent,
    Faulty,
    Bridge,
    Drive,
}

/// Error of the text of a key.
fn of_key(key: &'static str) -> impl Fn(String) -> String {
    move |error| format!("`{key}`: {error}")
}

impl RawNode {
    /// The keys of one kind only, and whether they are given.
    fn keys(&self) -> [(RawNodeKind, &'static str, bool); 21] {
        use RawNodeKind::{Bridge, Drive, Faulty, Replay};
        [
            (Faulty, "drop_permille", self.drop_permille.is_some()),
            (Faulty, "corrupt_permille", self.corrupt_permille.is_some()),
            (Faulty, "repeat_permille", self.repeat_permille.is_some()),
            (Faulty, "babble_us", self.babble_us.is_some()),
            (Bridge, "protocol", self.protocol.is_some()),
            (Bridge, "address", self.address.is_some()),
            (Bridge, "port", self.port.is_some()),
            (Bridge, "max_clients", self.max_clients.is_some()),
            (Bridge, "queue", self.queue.is_some()),
            (Drive, "node_id", self.node_id.is_some()),
            (Drive, "eds", self.eds.is_some()),
            (Drive, "serial", self.serial.is_some()),
            (Drive, "axes", self.axes.is_some()),
            (Drive, "boot_ms", self.boot_ms.is_some()),
            (Drive, "sdo_delay_us", self.sdo_delay_us.is_some()),
            (Drive, "enable_ms", self.enable_ms.is_some()),
            (Drive, "motor", self.motor.is_some()),
            (Drive, "quirks", self.quirks.is_some()),
            (Replay, "file", self.file.is_some()),
            (Replay, "format", self.format.is_some()),
            (Replay, "time_stamps", self.time_stamps.is_some()),
        ]
    }

    pub(super) fn build(
        mut self,
        scenario: &Scenario,
        directory: &Path,
    ) -> Result<NodeSpec, String> {
        if !scenario.gateways.iter().any(|gateway| gateway.buses.contains(&self.bus)) {
            let buses: Vec<_> =
                scenario.gateways.iter().flat_map(|gateway| &gateway.buses).cloned().collect();
            return Err(if buses.is_empty() {
                format!("bus \"{}\" does not exist; there are no gateways", self.bus)
            } else {
                format!("bus \"{}\" does not exist; there are: {}", self.bus, buses.join(", "))
            });
        }
        let stray =
            self.keys().into_iter().find(|(kind, _, is_given)| *is_given && *kind != self.kind);
        if let Some((kind, key, _)) = stray {
            let kind = format!("{kind:?}").to_lowercase();
            return Err(format!("`{key}` belongs to nodes of kind \"{kind}\""));
        }
        let shares = [self.drop_permille, self.corrupt_permille, self.repeat_permille];
        if shares.into_iter().flatten().any(|share| share > 1000) {
            return Err("a rate in thousandths is out of range; allowed: 0 to 1000".to_owned());
        }
        if self.bitrate == Some(0) || self.data_bitrate == Some(0) {
            return Err("a bit rate must not be 0".to_owned());
        }
        if self.data_bitrate.is_some() && self.bitrate.is_none() {
            return Err("`data_bitrate` needs `bitrate`".to_owned());
        }
        let name = self.name.take().unwrap_or_else(|| format!("node {}", scenario.nodes.len()));
        if scenario.nodes.iter().any(|node| node.name == name) {
            return Err(format!("two nodes have the name \"{name}\""));
        }
        let (bus, bitrate, data_bitrate) = (self.bus.clone(), self.bitrate, self.data_bitrate);
        let physical_layer = self.physical_layer().build()?;
        let kind = match self.kind {
            RawNodeKind::Echo => NodeKind::Echo,
            RawNodeKind::Silent => NodeKind::Silent,
            RawNodeKind::Faulty => NodeKind::Faulty(FaultyConfig {
                drop_permille: self.drop_permille.unwrap_or(0),
                corrupt_permille: self.corrupt_permille.unwrap_or(0),
                repeat_permille: self.repeat_permille.unwrap_or(0),
                babble_us: self.babble_us.unwrap_or(0),
            }),
            RawNodeKind::Bridge => NodeKind::Bridge(self.bridge()?),
            RawNodeKind::Drive => NodeKind::Drive(Box::new(self.drive(scenario, directory)?)),
            RawNodeKind::Replay => {
                let file = self.file.ok_or("a node of kind \"replay\" needs `file`")?;
                let format =
                    self.format.map(|it| it.parse().map_err(of_key("format"))).transpose()?;
                let times = self.time_stamps.map(|it| it.parse().map_err(of_key("time_stamps")));
                let options = ReadOptions { format, screen_times: times.transpose()? };
                NodeKind::Replay { file: directory.join(file), options }
            }
        };
        Ok(NodeSpec { name, bus, kind, bitrate, data_bitrate, physical_layer })
    }

    fn physical_layer(&self) -> RawPhysicalLayer {
        RawPhysicalLayer {
            sample_point: self.sample_point,
            data_sample_point: self.data_sample_point,
            tdc: self.tdc,
            tdc_offset_ns: self.tdc_offset_ns,
            cable_ns: self.cable_ns,
            transceiver_ns: self.transceiver_ns,
        }
    }

    fn bridge(&self) -> Result<BridgeSpec, String> {
        if self.max_clients == Some(0) || self.queue == Some(0) {
            return Err("a bridge needs `max_clients` and `queue` above 0".to_owned());
        }
        Ok(BridgeSpec {
            protocol: self.protocol.unwrap_or_default(),
            address: self.address,
            port: self.port.unwrap_or(0),
            max_clients: self.max_clients,
            queue: self.queue,
        })
    }

    fn drive(self, scenario: &Scenario, directory: &Path) -> Result<DriveSpec, String> {
        let node = self.node_id.ok_or("a node of kind \"drive\" needs `node_id`")?;
        let node = NodeId::new(node)
            .ok_or_else(|| format!("`node_id` {node} is out of range; allowed: 1 to 127"))?;
        let is_same = |other: &&NodeSpec| {
            other.bus == self.bus
                && matches!(&other.kind, NodeKind::Drive(drive) if drive.config.node == node)
        };
        if let Some(other) = scenario.nodes.iter().find(is_same) {
            return Err(format!("node-ID {node} is already used by \"{}\"", other.name));
        }
        let mut config = DriveConfig::new(node);
        set!(config from self: axes, serial, boot_ms, sdo_delay_us, enable_ms, motor, quirks);
        config.motor.check()?;
        if !(1..=8).contains(&config.axes) {
            return Err(format!("`axes` = {} is out of range; allowed: 1 to 8", config.axes));
        }
        let eds = self.eds.map(|file| directory.join(file));
        Ok(DriveSpec { config, eds })
    }
}
