//! A node in the world: what it is, its controller, its queue.

use ecan_protocol::can::{CanFrame, CanId};

use crate::backend_error::BackendError;
use crate::bus::{StationConfig, StationId};
use crate::drive::Drive;
use crate::node::{
    BridgeFactory, EchoNode, FaultyConfig, FaultyNode, Node, NodeOutput, ReplayNode, SilentNode,
};
use crate::scenario::{DriveSpec, NodeKind, NodeSpec};

/// A node; drives are kept apart because tests look into them and faults strike them.
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

    pub(super) fn into_node(self) -> Box<dyn Node> {
        match self {
            Self::Drive(drive) => drive,
            Self::Other(node) => node,
        }
    }

    /// When it has to act by itself at the latest. A drive may be [behind](Self::catch_up) until
    /// then.
    pub(super) fn next_due(&self) -> Option<u64> {
        match self {
            Self::Drive(drive) => drive.next_due(),
            Self::Other(node) => node.next_event(),
        }
    }

    /// Does what a node puts off while no one looks at it.
    pub(super) fn catch_up(&mut self, now: u64) {
        if let Self::Drive(drive) = self {
            drive.catch_up(now);
        }
    }

    /// A frame has been received. Whether it meant anything to the node.
    pub(super) fn received(&mut self, now: u64, frame: &CanFrame, out: &mut NodeOutput) -> bool {
        match self {
            Self::Drive(drive) => drive.takes(now, frame, out),
            Self::Other(node) => {
                node.received(now, frame, out);
                true
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

/// A node on its bus.
pub(super) struct NodeSlot {
    pub(super) name: String,
    pub(super) node: NodeBody,
    pub(super) bus: usize,
    pub(super) station: StationId,
    /// Its own bit rates; `None` follows the gateway.
    pub(super) fixed: Option<StationConfig>,
    /// The bit rates it has; it has started with the first.
    pub(super) config: Option<StationConfig>,
    /// Frames that wait for the bus.
    pub(super) output: NodeOutput,
    pub(super) muted_until: u64,
    /// Something has happened to it on the bus, so that its output has to be looked at.
    pub(super) is_concerned: bool,
    /// It has lost its turn at this instant and gets it right behind.
    pub(super) is_postponed: bool,
    /// Taken off the bus for good.
    pub(super) detached: bool,
}

impl NodeSlot {
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
            NodeKind::Replay { file } => other(Box::new(read_log(file)?)),
            NodeKind::Bridge(bridge) => {
                let node = spec.name.clone();
                let make = bridges.ok_or(BackendError::NoBridges { node })?;
                other(make(bridge).map_err(BackendError::Bridge)?)
            }
            NodeKind::Faulty(behaviour) => other(Box::new(FaultyNode::new(FaultyConfig {
                seed,
                drop_per_mille: behaviour.drop_permille,
                corrupt_per_mille: behaviour.corrupt_permille,
                repeat_per_mille: behaviour.repeat_permille,
                babble: if behaviour.babble_us > 0 { babble() } else { None },
                babble_interval_ns: u64::from(behaviour.babble_us) * 1_000,
            }))),
            NodeKind::Drive(drive) => NodeBody::Drive(Box::new(make_drive(drive)?)),
        };
        let fixed = spec.bitrate.map(|nominal| match spec.data_bitrate {
            Some(data) => StationConfig::fd(nominal, data),
            None => StationConfig::classic(nominal),
        });
        Ok(Self { fixed, ..Self::with_node(spec.name.clone(), node, bus, station) })
    }

    /// A node that follows the bit rates of the gateway.
    pub(super) fn with_node(name: String, node: NodeBody, bus: usize, station: StationId) -> Self {
        Self {
            name,
            node,
            bus,
            station,
            fixed: None,
            config: None,
            output: NodeOutput::new(),
            muted_until: 0,
            is_concerned: false,
            is_postponed: false,
            detached: false,
        }
    }
}

/// What a babbling node says: the identifier that wins every arbitration.
fn babble() -> Option<CanFrame> {
    CanFrame::classic(CanId::standard(0).ok()?, &[0xBB; 8]).ok()
}

fn read_log(path: &std::path::Path) -> Result<ReplayNode, BackendError> {
    let text = std::fs::read_to_string(path)
        .map_err(|error| BackendError::Read { path: path.to_owned(), error })?;
    ReplayNode::from_log(&text, None).map_err(|error| BackendError::Log {
        path: path.to_owned(),
        line: error.line,
        reason: error.cause.to_string(),
    })
}

fn make_drive(spec: &DriveSpec) -> Result<Drive, BackendError> {
    let Some(path) = &spec.eds else { return Ok(Drive::new(&spec.settings)) };
    let text = std::fs::read_to_string(path)
        .map_err(|error| BackendError::Read { path: path.clone(), error })?;
    Drive::from_eds(&spec.settings, &text)
        .map_err(|error| BackendError::Eds { path: path.clone(), error })
}
