//! slcan and socketcand bridges as nodes of simulated CAN buses.
//!
//! The simulator reads nodes of kind `bridge` from scenario files, but opens no TCP port itself. A
//! program that supports them sets [`SimOptions::bridges`](ecan_sim::SimOptions::bridges) to
//! [`make`].
//!
//! Frames of the clients wait until simulated time advances, and it advances only while a master's
//! cycle or a [`RealTimeRunner`](ecan_sim::RealTimeRunner) drives the simulation.
#![forbid(unsafe_code)]

mod attached;
mod bridge_node;

use std::any::Any;
use std::error::Error;

use ecan_sim::{BridgeSpec, Node, Simulation};

pub use attached::{Bridge, BridgeError, attach};
pub use bridge_node::BridgeNode;
pub use ecan_bridge::BridgeInfo;

/// Makes the bridge of a scenario; it listens at once.
///
/// # Errors
/// A [`ServerError`](ecan_bridge::ServerError).
pub fn make(spec: &BridgeSpec) -> Result<Box<dyn Node>, Box<dyn Error + Send + Sync>> {
    Ok(Box::new(BridgeNode::listen(spec)?))
}

/// The bridges of a simulation with the names of their buses, those of the scenario first.
#[must_use]
pub fn bridges(simulation: &Simulation) -> Vec<(String, BridgeInfo)> {
    simulation.with_world(|world| {
        let bridges = world.nodes().filter_map(|(bus, node)| {
            let node = (node as &dyn Any).downcast_ref::<BridgeNode>()?;
            Some((bus.to_owned(), node.info().clone()))
        });
        bridges.collect()
    })
}
