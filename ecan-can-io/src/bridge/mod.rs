//! A CAN bus for other programs: servers for slcan and socketcand over TCP, slcan on a
//! pseudo-terminal and, with the feature `socketcan`, the CAN interfaces of Linux.
//!
//! The owner of a bus, simulated or real, creates a [`BridgeServer`], a [`SerialBridge`] or a
//! `SocketCanBridge`, takes the frames of its clients with [`next_for_bus`](Clients::next_for_bus)
//! and passes the frames of the bus to [`deliver`](Clients::deliver). Neither blocks: the clients
//! have their own threads, and a bounded queue drops and counts what exceeds it.

mod client_queue;
mod clients;
mod config;
mod connection;
mod server;
mod session;
mod slcan;
#[cfg(feature = "socketcan")]
mod socketcan;
mod socketcand;
#[cfg(test)]
mod test_frames;

pub use clients::{ClientFrame, ClientId, Clients};
pub use config::{
    BridgeConfig, BridgeProtocol, BridgeStatistics, BusEvent, BusRates, ErrorCounters,
};
pub use server::{BridgeInfo, BridgeServer, SerialBridge, ServerError};
#[doc(hidden)]
pub use session::OfflineSession;

#[cfg(feature = "socketcan")]
pub use self::socketcan::{SocketCanBridge, SocketCanError};
