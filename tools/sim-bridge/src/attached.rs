use ecan_bridge::{BridgeInfo, ServerError};
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
    /// Address, with the actual port, and counters; a clone may outlive the bridge.
    pub info: BridgeInfo,
    _node: AttachedNode,
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
