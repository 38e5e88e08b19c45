//! Nodes on the CAN buses.
//!
//! A node decides what to send and when; its controller (a [`StationConfig`](crate::StationConfig))
//! and its queue belong to the world.

mod builtin;
mod interface;

pub use builtin::{EchoNode, FaultyConfig, FaultyNode, ReplayNode, ReplayRecord, SilentNode};
pub use interface::{BridgeFactory, BridgeProtocol, BridgeSpec, Node, NodeOutput};
