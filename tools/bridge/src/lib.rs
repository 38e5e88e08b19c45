//! A CAN bus for other programs: servers that speak slcan or socketcand over TCP, slcan on a
//! pseudo-terminal and, with the feature `socketcan`, the CAN interfaces of Linux.
//!
//! Whoever has a bus, simulated or real, puts a [`BridgeServer`], a [`SerialBridge`] or a
//! `SocketCanBridge` beside it, takes the frames of its clients with
//! [`next_for_bus`](Clients::next_for_bus) and hands over what is on the bus with
//! [`deliver`](Clients::deliver). Neither blocks: the clients have threads of their own, and what is
//! too much for a bounded queue is dropped and counted.
#![forbid(unsafe_code)]

mod clients;
mod connection;
mod conversation;
#[cfg(test)]
mod frame_strategies;
mod hub;
mod info;
mod outbox;
mod rates;
mod serial;
mod server;
mod session;
mod settings;
mod slcan;
#[cfg(feature = "socketcan")]
mod socketcan;
mod socketcand;
mod statistics;
mod terminal;
mod writer;

#[cfg(feature = "socketcan")]
pub use self::socketcan::{SocketCanBridge, SocketCanError};
pub use clients::Clients;
#[doc(hidden)]
pub use conversation::OfflineSession;
pub use hub::ClientId;
pub use info::BridgeInfo;
pub use rates::BusRates;
pub use serial::SerialBridge;
pub use server::{BridgeServer, ServerError};
pub use settings::{BridgeConfig, BridgeProtocol};
pub use statistics::BridgeStatistics;
