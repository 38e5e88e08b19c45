//! Nodes in a scenario file.

use std::net::IpAddr;
use std::path::{Path, PathBuf};

use serde::Deserialize;

use crate::node::{BridgeProtocol, BridgeSpec};
use crate::scenario::file::raw_drive::{RawMotor, RawQuirks};
use crate::scenario::{FaultyBehaviour, NodeKind, NodeSpec, Scenario};

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawNode {
    kind: RawNodeKind,
    bus: String,
    name: Option<String>,
    bitrate: Option<u32>,
    data_bitrate: Option<u32>,
    file: Option<PathBuf>,
    drop_permille: Option<u16>,
    corrupt_permille: Option<u16>,
    repeat_permille: Option<u16>,
    babble_us: Option<u32>,
    protocol: Option<BridgeProtocol>,
    address: Option<IpAddr>,
    port: Option<u16>,
    max_clients: Option<usize>,
    queue: Option<usize>,
    pub(super) node_id: Option<u8>,
    pub(super) eds: Option<PathBuf>,
    pub(super) serial: Option<u32>,
    pub(super) boot_ms: Option<u32>,
    pub(super) sdo_delay_us: Option<u32>,
    pub(super) enable_ms: Option<u32>,
    pub(super) motor: Option<RawMotor>,
    pub(super) quirks: Option<RawQuirks>,
}

#[derive(Deserialize, Clone, Copy, PartialEq)]
#[serde(rename_all = "lowercase")]
enum RawNodeKind {
    Echo,
    Replay,
    Silent,
    Faulty,
    Bridge,
    Drive,
}

impl RawNode {
    pub(super) fn build(
        mut self,
        scenario: &Scenario,
        directory: &Path,
    ) -> Result<NodeSpec, String> {
        if !scenario.gateways.iter().any(|gateway| gateway.buses.contains(&self.bus)) {
            let buses: Vec<_> =
                scenario.gateways.iter().flat_map(|gateway| &gateway.buses).cloned().collect();
            return Err(if buses.is_empty() {
                format!("bus \"{}\" does not exist: there is no gateway", self.bus)
            } else {
                format!("bus \"{}\" does not exist; there are: {}", self.bus, buses.join(", "))
            });
        }
        let for_faulty = [
            ("drop_permille", self.drop_permille.is_some()),
            ("corrupt_permille", self.corrupt_permille.is_some()),
            ("repeat_permille", self.repeat_permille.is_some()),
            ("babble_us", self.babble_us.is_some()),
        ];
        let stray = for_faulty.iter().find(|(_, given)| *given && self.kind != RawNodeKind::Faulty);
        if let Some((key, _)) = stray {
            return Err(format!("`{key}` belongs to nodes of kind \"faulty\""));
        }
        let for_bridge = [
            ("protocol", self.protocol.is_some()),
            ("address", self.address.is_some()),
            ("port", self.port.is_some()),
            ("max_clients", self.max_clients.is_some()),
            ("queue", self.queue.is_some()),
        ];
        let stray = for_bridge.iter().find(|(_, given)| *given && self.kind != RawNodeKind::Bridge);
        if let Some((key, _)) = stray {
            return Err(format!("`{key}` belongs to nodes of kind \"bridge\""));
        }
        if self.kind != RawNodeKind::Drive
            && let Some(key) = self.drive_key()
        {
            return Err(format!("`{key}` belongs to nodes of kind \"drive\""));
        }
        if self.file.is_some() && self.kind != RawNodeKind::Replay {
            return Err("`file` belongs to nodes of kind \"replay\"".to_owned());
        }
        let shares = [self.drop_permille, self.corrupt_permille, self.repeat_permille];
        if shares.into_iter().flatten().any(|share| share > 1000) {
            return Err("a share is given in thousandths, 0 to 1000".to_owned());
        }
        if self.bitrate == Some(0) || self.data_bitrate == Some(0) {
            return Err("a bit rate is not 0".to_owned());
        }
        if self.data_bitrate.is_some() && self.bitrate.is_none() {
            return Err("`data_bitrate` needs `bitrate` beside it".to_owned());
        }
        let kind = match self.kind {
            RawNodeKind::Echo => NodeKind::Echo,
            RawNodeKind::Silent => NodeKind::Silent,
            RawNodeKind::Faulty => NodeKind::Faulty(FaultyBehaviour {
                drop_permille: self.drop_permille.unwrap_or(0),
                corrupt_permille: self.corrupt_permille.unwrap_or(0),
                repeat_permille: self.repeat_permille.unwrap_or(0),
                babble_us: self.babble_us.unwrap_or(0),
            }),
            RawNodeKind::Bridge => NodeKind::Bridge(self.bridge()?),
            RawNodeKind::Drive => NodeKind::Drive(Box::new(self.drive(directory)?)),
            RawNodeKind::Replay => {
                let file = self.file.ok_or("a node of kind \"replay\" needs `file`")?;
                NodeKind::Replay { file: directory.join(file) }
            }
        };
        let name = self.name.unwrap_or_else(|| format!("node {}", scenario.nodes.len()));
        if scenario.nodes.iter().any(|node| node.name == name) {
            return Err(format!("there are two nodes of the name \"{name}\""));
        }
        if let NodeKind::Drive(drive) = &kind {
            let node = drive.settings.node;
            let same = |other: &&NodeSpec| {
                let same_id =
                    matches!(&other.kind, NodeKind::Drive(one) if one.settings.node == node);
                same_id && other.bus == self.bus
            };
            if let Some(other) = scenario.nodes.iter().find(same) {
                return Err(format!("node id {node} is that of \"{}\" already", other.name));
            }
        }
        Ok(NodeSpec {
            name,
            bus: self.bus,
            kind,
            bitrate: self.bitrate,
            data_bitrate: self.data_bitrate,
        })
    }
}

impl RawNode {
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
}
