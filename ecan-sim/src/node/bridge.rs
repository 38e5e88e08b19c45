//! Bridges of a scenario. The node itself is made by the program: this crate opens no TCP port.

use std::error::Error;
use std::net::IpAddr;

use serde::Deserialize;

use super::Node;

/// Protocol between a bridge and its clients.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum BridgeProtocol {
    /// ASCII protocol of Lawicel's serial adapters, over TCP.
    #[default]
    Slcan,
    /// Raw mode of socketcand; classic CAN only.
    Socketcand,
}

/// A node that connects other programs to its bus over TCP. `None` leaves a value to the
/// [`BridgeFactory`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct BridgeSpec {
    /// Protocol.
    pub protocol: BridgeProtocol,
    /// Address on which it listens; `None` is the loopback interface.
    pub address: Option<IpAddr>,
    /// TCP port; 0 takes any free one.
    pub port: u16,
    /// Maximum number of clients.
    pub max_clients: Option<usize>,
    /// Capacity in frames of the queue to the bus, and of the queue to each client.
    pub queue: Option<usize>,
}

/// Makes the bridge of a scenario; the module `bridge` contains one.
pub type BridgeFactory = fn(&BridgeSpec) -> Result<Box<dyn Node>, Box<dyn Error + Send + Sync>>;
