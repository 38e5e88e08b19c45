//! A bridge that is put on a bus while the simulation runs.

use std::net::SocketAddr;

use ecan_bridge::{BridgeInfo, BridgeStatistics, ServerError};

use crate::simulation::Simulation;

/// Why a bridge cannot be attached.
#[derive(Debug, thiserror::Error)]
pub enum BridgeError {
    /// No bus has this name.
    #[error("bus \"{bus}\" does not exist; there are: {known}")]
    UnknownBus {
        /// The name.
        bus: String,
        /// The names that there are.
        known: String,
    },
    /// It cannot listen.
    #[error(transparent)]
    Server(#[from] ServerError),
}

/// A bridge that was attached with [`Simulation::attach_bridge`]. Dropping it takes the bridge off
/// its bus, closes its connections and ends its threads.
#[derive(Debug)]
pub struct Bridge {
    simulation: Simulation,
    node: usize,
    info: BridgeInfo,
}

impl Bridge {
    pub(crate) fn new(simulation: Simulation, node: usize, info: BridgeInfo) -> Self {
        Self { simulation, node, info }
    }

    /// Where it listens, with the real port.
    pub fn address(&self) -> SocketAddr {
        self.info.address()
    }

    /// What it has done so far.
    pub fn statistics(&self) -> BridgeStatistics {
        self.info.statistics()
    }

    /// The same look at it in a form that may outlive it.
    pub fn info(&self) -> &BridgeInfo {
        &self.info
    }
}

impl Drop for Bridge {
    fn drop(&mut self) {
        // The node goes outside the world's lock: its threads take a moment to end.
        let node = self.simulation.with_world(|world| world.detach_node(self.node));
        drop(node);
    }
}
