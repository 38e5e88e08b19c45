//! A CAN bus for other programs: servers for slcan and socketcand over TCP, slcan on a
//! pseudo-terminal and, with the feature `socketcan`, the CAN interfaces of Linux.
//!
//! The owner of a bus, simulated or real, creates a [`BridgeServer`], a [`SerialBridge`] or a
//! `SocketCanBridge`, takes the frames of its clients with [`next_for_bus`](Clients::next_for_bus)
//! and passes the frames of the bus to [`deliver`](Clients::deliver). Neither blocks: the clients
//! have their own threads, and a bounded queue drops and counts what exceeds it.

mod bus_event;
mod client_queue;
mod clients;
#[cfg(feature = "socketcan")]
mod command;
mod config;
mod connection;
#[cfg(test)]
mod frame_strategies;
mod info;
mod offline_session;
mod rates;
mod serial;
mod server;
mod session;
mod slcan;
#[cfg(feature = "socketcan")]
mod socketcan;
mod socketcand;
mod statistics;
mod terminal;
mod uplink;
mod writer;

#[cfg(feature = "socketcan")]
pub use self::socketcan::{SocketCanBridge, SocketCanError};
pub use bus_event::{BusEvent, ErrorCounters};
pub use clients::{ClientFrame, ClientId, Clients};
pub use config::{BridgeConfig, BridgeProtocol};
pub use info::BridgeInfo;
#[doc(hidden)]
pub use offline_session::OfflineSession;
pub use rates::BusRates;
pub use serial::SerialBridge;
pub use server::{BridgeServer, ServerError};
pub use statistics::BridgeStatistics;
