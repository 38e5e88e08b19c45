//! What a bridge is told.

use std::net::{IpAddr, Ipv4Addr, SocketAddr};

/// What a bridge speaks with its clients.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum BridgeProtocol {
    /// The ASCII protocol of Lawicel's serial adapters with the CAN FD commands of CANable 2:
    /// python-can's interface `slcan` on the channel `socket://127.0.0.1:PORT`.
    #[default]
    Slcan,
    /// The raw mode of socketcand: python-can's interface `socketcand`. Classic CAN only.
    Socketcand,
}

/// Settings of a bridge. Plain data.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BridgeConfig {
    /// What it speaks.
    pub protocol: BridgeProtocol,
    /// Where it listens. Port 0 takes any free one. Whoever reaches this address can send on the
    /// bus.
    pub address: SocketAddr,
    /// Clients at a time; more are turned away.
    pub max_clients: usize,
    /// Frames that may wait for the bus, and frames that may wait for each client.
    pub queue: usize,
}

impl Default for BridgeConfig {
    /// slcan on a free port of the loopback interface, 8 clients, 4096 frames.
    fn default() -> Self {
        Self {
            protocol: BridgeProtocol::Slcan,
            address: SocketAddr::new(IpAddr::V4(Ipv4Addr::LOCALHOST), 0),
            max_clients: 8,
            queue: 4096,
        }
    }
}

impl BridgeConfig {
    /// The default settings with another protocol.
    #[must_use]
    pub fn speaking(protocol: BridgeProtocol) -> Self {
        Self { protocol, ..Self::default() }
    }
}
