//! A node in the world with its controller, its queue and its faults.

use std::path::Path;

use ecan_can_io::recording::{ReadOptions, Recording};
use ecan_canopen::{DeviceFile, Emcy, ErrorRegister};
use ecan_protocol::can::CanFrame;

use crate::backend_error::BackendError;
use crate::bus::{StationConfig, StationId};
use crate::drive::Drive;
use crate::event_queue::{NEVER, ms};
use crate::fault::DriveFault;
use crate::node::{BridgeFactory, EchoNode, FaultyNode, Node, NodeOutput, ReplayNode, SilentNode};
use crate::scenario::{DriveSpec, NodeKind, NodeSpec};
use crate::world::bus_slot::BusSlot;

/// A node; drives are kept apart because tests read them and faults address them.
pub(super) enum NodeBody {
    Drive(Box<Drive>),
    Other(Box<dyn Node>),
}

impl NodeBody {
    pub(super) fn as_node(&self) -> &dyn Node {
        match self {
            Self::Drive(drive) => &**drive,
            Self::Other(node) => &**node,
        }
    }

    fn try_clone(&self) -> Option<Self> {
        match self {
            Self::Drive(drive) => Some(Self::Drive(drive.clone())),
            Self::Other(node) => node.try_clone().map(Self::Other),
        }
    }

    pub(super) fn into_node(self) -> Box<dyn Node> {
        match self {
            Self::Drive(drive) => drive,
            Self::Other(node) => node,
        }
    }

    /// Time at which the node must run at the latest. A drive may be [late](Self::catch_up) until
    /// then.
    pub(super) fn next_due(&self) -> Option<u64> {
        match self {
            Self::Drive(drive) => drive.next_due(),
            Self::Other(node) => node.next_event(),
        }
    }

    /// Executes what a node has postponed.
    pub(super) fn catch_up(&mut self, now: u64) {
        if let Self::Drive(drive) = self {
            drive.catch_up(now);
        }
    }

    /// Receives a frame; returns whether the node used it.
    pub(super) fn received(&mut self, now: u64, frame: &CanFrame, out: &mut NodeOutput) -> bool {
        match self {
            Self::Drive(drive) => drive.receive(now, frame, out),
            Self::Other(node) => {
                node.received(now, frame, out);
                true
            }
        }
    }

    /// The bus has sent a frame of the node.
    pub(super) fn transmitted(&mut self, now: u64, frame: &CanFrame, out: &mut NodeOutput) {
        match self {
            Self::Drive(drive) => drive.transmitted(now, frame, out),
            Self::Other(node) => node.transmitted(now, frame, out),
        }
    }

    pub(super) fn controller(&self) -> NodeController {
        match self {
            Self::Drive(drive) => {
                NodeController { is_on_bus: drive.is_on_bus(), bit_rate: drive.bit_rate() }
            }
            Self::Other(node) => {
                NodeController { is_on_bus: node.is_on_bus(), bit_rate: node.bit_rate() }
            }
        }
    }

    pub(super) fn as_node_mut(&mut self) -> &mut dyn Node {
        match self {
            Self::Drive(drive) => &mut **drive,
            Self::Other(node) => &mut **node,
        }
    }
}

/// State of a node's controller, as the node demands it.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) struct NodeController {
    pub(super) is_on_bus: bool,
    /// Own nominal bit rate.
    pub(super) bit_rate: Option<u32>,
}

pub(super) struct NodeSlot {
    pub(super) name: String,
    pub(super) node: NodeBody,
    pub(super) bus: usize,
    pub(super) station: StationId,
    /// Its own bit rates; `None` uses those of the gateway.
    pub(super) fixed: Option<StationConfig>,
    /// Active bit rates; the node starts with the first.
    pub(super) config: Option<StationConfig>,
    /// What the station is configured by; `None` after a change of `config`.
    pub(super) controller: Option<NodeController>,
    /// Version of the drive's [filter](Drive::filter_version) that the bus applies.
    pub(super) filter_version: u32,
    pub(super) output: NodeOutput,
    pub(super) muted_until: u64,
    /// An event on the bus concerned the node: its output must be read.
    pub(super) has_events: bool,
    /// The node lost its turn at this instant and runs right after.
    pub(super) is_postponed: bool,
    /// Removed from the bus for good.
    pub(super) detached: bool,
    /// Code of the application, which may connect the bus with others or with another process.
    pub(super) is_external: bool,
}

impl NodeSlot {
    /// Name and drive, if the node is one.
    pub(super) fn drive(&self) -> Option<(&str, &Drive)> {
        match &self.node {
            NodeBody::Drive(drive) => Some((&self.name, drive)),
            NodeBody::Other(_) => None,
        }
    }

    /// Reads what a node has to send and when it is due, and connects or disconnects its controller. Returns
    /// whether the bus must be planned again.
    pub(super) fn collect(&mut self, now: u64, nodes_had_turn: bool, bus: &mut BusSlot) -> bool {
        self.has_events = false;
        let controller = self.node.controller();
        if self.controller != Some(controller) {
            self.controller = Some(controller);
            let config = self.config.filter(|_| controller.is_on_bus).map(|config| StationConfig {
                nominal_bitrate: controller.bit_rate.unwrap_or(config.nominal_bitrate),
                ..config
            });
            if bus.bus.config(self.station) != config {
                bus.bus.configure(now, self.station, config);
            }
        }
        if let NodeBody::Drive(drive) = &self.node
            && self.filter_version != drive.filter_version()
        {
            self.filter_version = drive.filter_version();
            bus.listeners.filter(self.station.index(), drive.standard_ids());
        }
        if now < self.muted_until || self.config.is_none() || !controller.is_on_bus {
            self.output.clear();
        }
        self.is_postponed = false;
        let due = if nodes_had_turn {
            self.node.next_due()
        } else {
            // What is due now comes after the event that is being processed.
            self.node.catch_up(now - 1);
            let due = self.node.as_node().next_event();
            self.is_postponed = due.is_some_and(|at| at <= now);
            due
        };
        bus.nodes_due.set(self.station.index(), due.map_or(NEVER, |at| at.max(now + 1)));
        if let Some(frame) = self.output.front()
            && !bus.bus.is_offering(self.station)
            && bus.bus.offer_unplanned(now, self.station, frame)
        {
            self.output.pop();
            return true;
        }
        false
    }

    /// Injects a fault in a drive. Returns whether the node is a drive.
    pub(super) fn inject(&mut self, now: u64, fault: DriveFault) -> bool {
        let Self { node: NodeBody::Drive(drive), output, .. } = self else { return false };
        match fault {
            DriveFault::Error { code } => drive.fail(now, code, output),
            DriveFault::AxisError { axis, code } => {
                drive.fail_axis(now, axis.into(), code, output);
            }
            DriveFault::Emcy { code, register } => {
                let register = ErrorRegister(register);
                drive.warn(now, Emcy { code, register, manufacturer: [0; 5] }, output);
            }
            DriveFault::PowerCycle { off_ms } => drive.power_cycle(now, now + ms(off_ms)),
            DriveFault::BusOff { for_ms } => drive.bus_off(now, now + ms(for_ms), output),
            DriveFault::Value { index, subindex, value } => {
                drive.set_object(now, (index, subindex), value, output);
            }
            DriveFault::Blocked { for_ms } => drive.block(now, now + ms(for_ms), output),
        }
        true
    }

    /// Ends the node and returns it.
    pub(super) fn detach(&mut self) -> Box<dyn Node> {
        let silent = NodeBody::Other(Box::new(SilentNode));
        let node = std::mem::replace(&mut self.node, silent);
        (self.fixed, self.detached) = (None, true);
        self.config = None;
        self.controller = None;
        self.output.clear();
        node.into_node()
    }

    /// A copy of the node; `None` if it cannot be copied.
    pub(super) fn try_clone(&self) -> Option<Self> {
        let node = self.node.try_clone()?;
        Some(Self { name: self.name.clone(), node, output: self.output.clone(), ..*self })
    }

    pub(super) fn new(
        spec: &NodeSpec,
        bus: usize,
        station: StationId,
        seed: u64,
        bridges: Option<BridgeFactory>,
    ) -> Result<Self, BackendError> {
        let other = |node: Box<dyn Node>| NodeBody::Other(node);
        let node = match &spec.kind {
            NodeKind::Echo => other(Box::new(EchoNode::new())),
            NodeKind::Silent => other(Box::new(SilentNode)),
            NodeKind::Replay { file, options } => other(Box::new(read_log(file, options)?)),
            NodeKind::Bridge(bridge) => {
                let make = bridges.ok_or_else(|| BackendError::NoBridges(spec.name.clone()))?;
                other(make(bridge).map_err(BackendError::Bridge)?)
            }
            NodeKind::Faulty(config) => other(Box::new(FaultyNode::new(*config, seed))),
            NodeKind::Drive(drive) => NodeBody::Drive(Box::new(make_drive(drive)?)),
        };
        let fixed = spec.bitrate.map(|nominal| match spec.data_bitrate {
            Some(data) => StationConfig::fd(nominal, data),
            None => StationConfig::classic(nominal),
        });
        let is_external = matches!(spec.kind, NodeKind::Bridge(_));
        let slot = Self::with_node(spec.name.clone(), node, bus, station);
        Ok(Self { fixed, is_external, ..slot })
    }

    /// A node that uses the bit rates of the gateway.
    pub(super) fn with_node(name: String, node: NodeBody, bus: usize, station: StationId) -> Self {
        Self {
            name,
            node,
            bus,
            station,
            fixed: None,
            config: None,
            controller: None,
            filter_version: 0,
            output: NodeOutput::new(),
            muted_until: 0,
            has_events: false,
            is_postponed: false,
            detached: false,
            is_external: false,
        }
    }
}

fn read_log(path: &Path, options: &ReadOptions) -> Result<ReplayNode, BackendError> {
    let bytes = std::fs::read(path).map_err(|error| BackendError::Read(path.to_owned(), error))?;
    let recording = Recording::read(&bytes, options)
        .and_then(Recording::whole)
        .map_err(|error| BackendError::Recording(path.to_owned(), error))?;
    Ok(ReplayNode::from_recording(&recording, None))
}

fn make_drive(spec: &DriveSpec) -> Result<Drive, BackendError> {
    let Some(path) = &spec.eds else { return Ok(Drive::new(&spec.config)) };
    let bytes = std::fs::read(path).map_err(|error| BackendError::Read(path.clone(), error))?;
    let file = DeviceFile::parse(&bytes)
        .map_err(|faults| BackendError::DeviceFile(path.clone(), faults))?;
    Ok(Drive::from_device_file(&spec.config, &file))
}
