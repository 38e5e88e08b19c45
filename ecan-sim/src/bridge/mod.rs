//! A bridge between a simulated CAN bus and other programs: a station of the bus that speaks slcan
//! or socketcand over TCP.
//!
//! Other programs live in real time, so the simulation should too: a bridge makes frames of its
//! clients wait until simulated time moves, and time moves only while someone drives the
//! simulation, a master's cycle or a [`RealTimeRunner`](crate::RealTimeRunner).

// Simulation
mod attached;
mod hub;
mod info;
mod node;
mod settings;
mod statistics;

pub use attached::{Bridge, BridgeError};
pub use info::BridgeInfo;
pub use node::BridgeNode;
pub use settings::{BridgeProtocol, BridgeSettings};
pub use statistics::BridgeStatistics;

// Clients
mod server;
mod session;
mod slcan;
mod socketcand;

pub use server::ServerError as BridgeServerError;
