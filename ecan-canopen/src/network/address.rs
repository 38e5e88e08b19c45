//! Address and handle of a node.

use std::fmt;

use crate::NodeId;

/// Address of a CANopen node: gateway, channel and node-ID.
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

/// A node of one [`Network`](crate::Network), by its index there.
///
/// In another network it refers to another node or to none; a call for no node does nothing, or
/// returns its error.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct NodeHandle(pub(crate) usize);

impl NodeHandle {
    /// Index of the node, in the order in which nodes were added, from 0.
    pub fn index(self) -> usize {
        self.0
    }
}
