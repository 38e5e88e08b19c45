//! Which node is meant.

use std::fmt;

use crate::NodeId;

/// Where a CANopen node is: behind which gateway, on which channel, under which node-ID.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct NodeAddress {
    /// Slave index of the gateway in the Port.
    pub slave: usize,
    /// Channel of the gateway, 0..3.
    pub channel: u8,
    /// Node-ID, 1..127.
    pub node: NodeId,
}

impl fmt::Display for NodeAddress {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "node {} (slave {}, channel {})", self.node, self.slave, self.channel)
    }
}

/// A node of one [`Network`](crate::Network), by its place there.
///
/// Handing it to another network names another node or none; a call with one that names none
/// does nothing, or says so where it has an error to return.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct NodeHandle(pub(crate) usize);

impl NodeHandle {
    /// The node's place, in the order in which nodes were added, from 0.
    pub fn index(self) -> usize {
        self.0
    }
}
