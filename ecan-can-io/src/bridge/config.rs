//! Configuration of a bridge.

use std::net::{IpAddr, Ipv4Addr, SocketAddr};
use std::time::Duration;

/// Protocol between a bridge and its clients.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum BridgeProtocol {
    /// ASCII protocol of Lawicel's serial adapters with the CAN FD commands of CANable 2:
    /// python-can's interface `slcan` on the channel `socket://127.0.0.1:PORT`.
    #[default]
    Slcan,
    /// Raw mode of socketcand: python-can's interface `socketcand`. Classic CAN only.
    Socketcand,
}

impl BridgeProtocol {
    /// Name of the protocol.
    pub fn name(self) -> &'static str {
        match self {
            Self::Slcan => "slcan",
            Self::Socketcand => "socketcand",
        }
    }
}

/// Configuration of a bridge. Plain data.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BridgeConfig {
    /// Protocol.
    pub protocol: BridgeProtocol,
    /// Address on which it listens. Port 0 takes any free one. Everyone who can reach this address
    /// can send on the bus.
    pub address: SocketAddr,
    /// Maximum number of clients; more are rejected. A client that has not opened the bus loses its
    /// place if another one needs it.
    pub max_clients: usize,
    /// Capacity in frames of the queue from each client to the bus, and of the queue to each client.
    pub queue: usize,
    /// Time in which a client of socketcand opens the bus; then its connection is closed. A client of
    /// slcan may be silent for as long as no other one needs its place: a terminal program has the
    /// connection open while its user types.
    pub handshake: Duration,
}

impl Default for BridgeConfig {
    /// slcan on a free port of the loopback interface, 8 clients, 4096 frames, 10 s to open the bus.
    fn default() -> Self {
        Self {
            protocol: BridgeProtocol::Slcan,
            address: SocketAddr::new(IpAddr::V4(Ipv4Addr::LOCALHOST), 0),
            max_clients: 8,
            queue: 4096,
            handshake: Duration::from_secs(10),
        }
    }
}

impl BridgeConfig {
    /// The default configuration with another protocol.
    #[must_use]
    pub fn with_protocol(protocol: BridgeProtocol) -> Self {
        Self { protocol, ..Self::default() }
    }
}
