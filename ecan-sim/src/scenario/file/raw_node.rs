//! Tables of nodes, sample points and I/O slaves in a scenario file.

use std::net::IpAddr;
use std::path::{Path, PathBuf};

use ecan_can_io::recording::ReadOptions;
use ecan_canopen::NodeId;
use ecan_protocol::can::SamplePoint;
use serde::Deserialize;

use crate::bus::{DelayCompensation, PhysicalLayer};
use crate::drive::{DriveConfig, DriveQuirks, MotorConfig};
use crate::node::{BridgeProtocol, BridgeSpec, FaultyConfig};
use crate::scenario::model::IoBehaviourName;
use crate::scenario::{DriveSpec, IoBehaviour, IoSpec, NodeKind, NodeSpec, Scenario};

/// Replaces fields by those of a raw table that are given.
macro_rules! set {
    ($target:ident from $raw:ident: $($field:ident),+) => {
        $( if let Some(value) = $raw.$field { $target.$field = value; } )+
    };
}
pub(super) use set;

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
                let format = self
                    .format
                    .map(|format| format.parse().map_err(of_key("format")))
                    .transpose()?;
                let times =
                    self.time_stamps.map(|times| times.parse().map_err(of_key("time_stamps")));
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
        let node = NodeId::from_raw(node)
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

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawIo {
    position: usize,
    name: Option<String>,
    alias: Option<u16>,
    vendor_id: Option<u32>,
    product_code: Option<u32>,
    revision: Option<u32>,
    serial: Option<u32>,
    boot_ms: Option<u32>,
    outputs: Option<u8>,
    inputs: Option<u8>,
    #[serde(default)]
    behaviour: IoBehaviourName,
    values: Option<Vec<u8>>,
}

impl RawIo {
    /// Builds the slave of a scenario whose gateways are read; `slaves` is the number of all slaves.
    pub(super) fn build(self, scenario: &Scenario, slaves: usize) -> Result<IoSpec, String> {
        let position = self.position;
        if position >= slaves {
            return Err(format!(
                "`position` {position} is out of range; the line has {slaves} slave(s), {} of them \
                 gateways: allowed: 0 to {}",
                scenario.gateways.len(),
                slaves - 1
            ));
        }
        if scenario.ios.iter().any(|io| io.position == position) {
            return Err(format!("position {position} is used twice; each I/O has its own"));
        }
        let mut spec = IoSpec::at(position);
        set!(spec from self: name, alias, vendor_id, product_code, revision, serial, boot_ms);
        set!(spec from self: outputs, inputs);
        for (key, bytes) in [("outputs", spec.outputs), ("inputs", spec.inputs)] {
            if bytes > IoSpec::MAX_BYTES {
                return Err(format!(
                    "`{key}` is out of range; allowed: 0 to {} bytes",
                    IoSpec::MAX_BYTES
                ));
            }
        }
        if spec.outputs == 0 && spec.inputs == 0 {
            return Err("an I/O needs `outputs` or `inputs`; both are 0".to_owned());
        }
        spec.behaviour = behaviour(self.behaviour, self.values, spec.inputs)?;
        Ok(spec)
    }
}

fn behaviour(
    name: IoBehaviourName,
    values: Option<Vec<u8>>,
    inputs: u8,
) -> Result<IoBehaviour, String> {
    match (name, values) {
        (IoBehaviourName::Loopback, None) => Ok(IoBehaviour::Loopback),
        (IoBehaviourName::Counter, None) => Ok(IoBehaviour::Counter),
        (IoBehaviourName::Fixed, Some(values)) if values.len() > usize::from(inputs) => {
            Err(format!("`values` has {} bytes; `inputs` is {inputs}", values.len()))
        }
        (IoBehaviourName::Fixed, Some(values)) => Ok(IoBehaviour::Fixed(values)),
        (IoBehaviourName::Fixed, None) => {
            Err("behaviour \"fixed\" needs `values`, the input bytes".to_owned())
        }
        (_, Some(_)) => Err("`values` belongs to behaviour \"fixed\" only".to_owned()),
    }
}

const SAMPLE_POINTS: std::ops::RangeInclusive<f64> = 50.0..=95.0;
const CABLE_MAX_NS: u32 = 10_000;
const TRANSCEIVER_MAX_NS: u32 = 1_000;
const OFFSET_MAX_NS: u32 = 10_000;

/// Keys of a node.
#[derive(Clone, Copy)]
pub(super) struct RawPhysicalLayer {
    pub(super) sample_point: Option<f64>,
    pub(super) data_sample_point: Option<f64>,
    pub(super) tdc: Option<bool>,
    pub(super) tdc_offset_ns: Option<u32>,
    pub(super) cable_ns: Option<u32>,
    pub(super) transceiver_ns: Option<u32>,
}

impl RawPhysicalLayer {
    pub(super) fn build(self) -> Result<Option<PhysicalLayer>, String> {
        let Some(nominal) = self.sample_point else {
            let keys = [
                ("data_sample_point", self.data_sample_point.is_some()),
                ("tdc", self.tdc.is_some()),
                ("tdc_offset_ns", self.tdc_offset_ns.is_some()),
                ("cable_ns", self.cable_ns.is_some()),
                ("transceiver_ns", self.transceiver_ns.is_some()),
            ];
            let stray = keys.into_iter().find(|(_, is_given)| *is_given);
            return stray.map_or(Ok(None), |(key, _)| Err(format!("`{key}` needs `sample_point`")));
        };
        let data = self.data_sample_point.unwrap_or(nominal);
        let mut layer =
            PhysicalLayer::new(point("sample_point", nominal)?, point("data_sample_point", data)?);
        let offset_ns = self.tdc_offset_ns.unwrap_or(0);
        if self.tdc == Some(false) && self.tdc_offset_ns.is_some() {
            return Err("`tdc_offset_ns` needs `tdc`".to_owned());
        }
        check("tdc_offset_ns", offset_ns, OFFSET_MAX_NS)?;
        layer.compensation = match self.tdc {
            Some(false) => None,
            _ => Some(DelayCompensation { offset_ns, filter_ns: 0 }),
        };
        layer.cable_ns = self.cable_ns.unwrap_or(layer.cable_ns);
        check("cable_ns", layer.cable_ns, CABLE_MAX_NS)?;
        layer.transceiver_ns = self.transceiver_ns.unwrap_or(layer.transceiver_ns);
        check_transceiver(layer.transceiver_ns)?;
        Ok(Some(layer))
    }
}

pub(super) fn check_transceiver(ns: u32) -> Result<(), String> {
    check("transceiver_ns", ns, TRANSCEIVER_MAX_NS)
}

fn check(key: &str, value: u32, max: u32) -> Result<(), String> {
    if value > max {
        return Err(format!("`{key}` {value} is out of range; allowed: 0 to {max}"));
    }
    Ok(())
}

/// A sample point in percent.
fn point(key: &str, percent: f64) -> Result<SamplePoint, String> {
    if !SAMPLE_POINTS.contains(&percent) {
        let (min, max) = (SAMPLE_POINTS.start(), SAMPLE_POINTS.end());
        return Err(format!("`{key}` {percent} is out of range; allowed: {min} to {max}"));
    }
    Ok(SamplePoint((percent * 100.0).round() as u16))
}
