//! Address and counters of a bridge.

use std::fmt;
use std::net::SocketAddr;
use std::sync::Arc;

use crate::bridge::clients::Clients;
use crate::bridge::config::BridgeProtocol;
use crate::bridge::statistics::BridgeStatistics;

/// Address and counters of a bridge. Does not keep it alive.
#[derive(Clone, Debug)]
pub struct BridgeInfo {
    pub(crate) protocol: BridgeProtocol,
    pub(crate) address: SocketAddr,
    pub(crate) clients: Arc<Clients>,
}

impl BridgeInfo {
    /// Protocol of the bridge.
    pub fn protocol(&self) -> BridgeProtocol {
        self.protocol
    }

    /// Address on which it listens, with the actual port.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// Counters of the bridge.
    pub fn statistics(&self) -> BridgeStatistics {
        self.clients.statistics()
    }
}

impl fmt::Display for BridgeInfo {
    /// Protocol and address, for example "slcan bridge at 127.0.0.1:29536".
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} bridge at {}", self.protocol.name(), self.address)
    }
}
