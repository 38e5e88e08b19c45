//! A bridge between a simulated CAN bus and other programs: a station of the bus behind which
//! `ecan-bridge` speaks slcan or socketcand over TCP.
//!
//! Other programs live in real time, so the simulation should too: a bridge makes frames of its
//! clients wait until simulated time moves, and time moves only while someone drives the
//! simulation, a master's cycle or a [`RealTimeRunner`](crate::RealTimeRunner).

mod attached;
mod node;

pub use attached::{Bridge, BridgeError};
pub use ecan_bridge::{
    BridgeConfig, BridgeInfo, BridgeProtocol, BridgeStatistics, ServerError as BridgeServerError,
};
pub use node::BridgeNode;
