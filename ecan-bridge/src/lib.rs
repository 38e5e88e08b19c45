//! A CAN bus for other programs: servers that speak slcan or socketcand over TCP.
//!
//! Whoever has a bus, simulated or real, puts a [`BridgeServer`] beside it, takes the frames of its
//! clients with [`next_for_bus`](BridgeServer::next_for_bus) and hands over what is on the bus with
//! [`deliver`](BridgeServer::deliver). Neither blocks: the clients have threads of their own, and
//! what is too much for a bounded queue is dropped and counted.
#![forbid(unsafe_code)]

mod hub;
mod info;
mod rates;
mod server;
mod session;
mod settings;
mod slcan;
mod socketcand;
mod statistics;

pub use hub::ClientId;
pub use info::BridgeInfo;
pub use rates::BusRates;
pub use server::{BridgeServer, ServerError};
pub use settings::{BridgeProtocol, BridgeSettings};
pub use statistics::BridgeStatistics;
