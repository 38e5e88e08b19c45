//! A CAN bus for other programs: servers for slcan and socketcand over TCP, slcan on a
//! pseudo-terminal and, with the feature `socketcan`, the CAN interfaces of Linux.
//!
//! The owner of a bus, simulated or real, creates a [`BridgeServer`], a [`SerialBridge`] or a
//! `SocketCanBridge`, takes the frames of its clients with [`next_for_bus`](Clients::next_for_bus)
//! and passes the frames of the bus to [`deliver`](Clients::deliver). Neither blocks: the clients
//! have their own threads, and a bounded queue drops and counts what exceeds it.

mod client_queue;
mod clients;
#[cfg(test)]
mod frame_strategies;
mod serial;
mod server;
mod session;
mod slcan;
#[cfg(feature = "socketcan")]
mod socketcan;
mod socketcand;
mod writer;

#[cfg(feature = "socketcan")]
pub use self::socketcan::{SocketCanBridge, SocketCanError};
pub use clients::BridgeStatistics;
pub use clients::BusRates;
pub use clients::{BusEvent, ErrorCounters};
pub use clients::{ClientFrame, ClientId, Clients};
pub use serial::SerialBridge;
pub use server::BridgeInfo;
pub use server::{BridgeConfig, BridgeProtocol};
pub use server::{BridgeServer, ServerError};
#[doc(hidden)]
pub use session::OfflineSession;
