use std::net::SocketAddr;

use ecan_bridge::{BridgeInfo, BridgeStatistics, ServerError};
use ecan_sim::{AttachedNode, BridgeSpec, Simulation, UnknownBus};

use crate::bridge_node::BridgeNode;

/// Reason why a bridge cannot be attached.
#[derive(Debug, thiserror::Error)]
pub enum BridgeError {
    /// No bus has this name.
    #[error(transparent)]
    UnknownBus(#[from] UnknownBus),
    /// The bridge cannot listen.
    #[error(transparent)]
    Server(#[from] ServerError),
}

/// A bridge that [`attach`] put on a bus. Dropping it removes the bridge from its bus, closes its
/// connections and ends its threads.
#[derive(Debug)]
pub struct Bridge {
    info: BridgeInfo,
    _node: AttachedNode,
}

impl Bridge {
    /// Address on which the bridge listens, with the actual port.
    pub fn address(&self) -> SocketAddr {
        self.info.address()
    }

    /// Counters of the bridge.
    pub fn statistics(&self) -> BridgeStatistics {
        self.info.statistics()
    }

    /// Address and counters in a form that may outlive the bridge.
    pub fn info(&self) -> &BridgeInfo {
        &self.info
    }
}

/// Puts a bridge on a bus, with the bit rates of the gateway channel there.
///
/// A bridge in a scenario (`kind = "bridge"`) may have its own bit rates and needs no running
/// gateway channel.
///
/// # Errors
/// The bus does not exist, or the bridge cannot listen.
pub fn attach(
    simulation: &Simulation,
    bus: &str,
    spec: &BridgeSpec,
) -> Result<Bridge, BridgeError> {
    let node = BridgeNode::listen(spec)?;
    let info = node.info().clone();
    let name = format!("bridge {}", info.address().port());
    let node = simulation.attach_node(bus, &name, Box::new(node))?;
    Ok(Bridge { info, _node: node })
}
