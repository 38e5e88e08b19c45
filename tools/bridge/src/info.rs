//! A look at a bridge from outside.

use std::fmt;
use std::net::SocketAddr;
use std::sync::Arc;

use crate::hub::Hub;
use crate::settings::BridgeProtocol;
use crate::statistics::BridgeStatistics;

/// Where a bridge listens and what it has done. Does not keep it alive.
#[derive(Clone, Debug)]
pub struct BridgeInfo {
    protocol: BridgeProtocol,
    address: SocketAddr,
    hub: Arc<Hub>,
}

impl BridgeInfo {
    pub(crate) fn new(protocol: BridgeProtocol, address: SocketAddr, hub: Arc<Hub>) -> Self {
        Self { protocol, address, hub }
    }

    /// What it speaks.
    pub fn protocol(&self) -> BridgeProtocol {
        self.protocol
    }

    /// Where it listens, with the real port.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// What it has done so far.
    pub fn statistics(&self) -> BridgeStatistics {
        self.hub.statistics()
    }
}

impl fmt::Display for BridgeInfo {
    /// Protocol and address, as in "slcan bridge at 127.0.0.1:29536".
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let protocol = match self.protocol {
            BridgeProtocol::Slcan => "slcan",
            BridgeProtocol::Socketcand => "socketcand",
        };
        write!(f, "{protocol} bridge at {}", self.address)
    }
}
