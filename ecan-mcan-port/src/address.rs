//! Addresses of gateways and channels in a Port, checked once.

use std::fmt;

use ecan_protocol::mapping::CHANNELS;
use thiserror::Error;

/// A gateway of a Port, from [`Port::gateway`](crate::Port::gateway).
///
/// A handle stays valid for the life of the Port. If [`Port::reconfigure`](crate::Port::reconfigure)
/// removes its gateway, calls with it behave as for a gateway that is not ready and has no channel:
/// getters return their initial values and frames are rejected with [`AddressError`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct GatewayHandle {
    slave: usize,
}

/// An enabled channel of a gateway, from [`Port::channel`](crate::Port::channel).
///
/// Valid as long as a [`GatewayHandle`]; if a reconfiguration disables the channel, frames for it
/// are rejected with [`AddressError`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct ChannelHandle {
    slave: usize,
    channel: u8,
}

impl GatewayHandle {
    pub(crate) const fn new(slave: usize) -> Self {
        Self { slave }
    }

    /// Slave index of the gateway.
    #[inline]
    pub const fn slave(self) -> usize {
        self.slave
    }
}

impl ChannelHandle {
    pub(crate) const fn new(slave: usize, channel: u8) -> Self {
        Self { slave, channel }
    }

    /// The gateway that the channel belongs to.
    #[inline]
    pub const fn gateway(self) -> GatewayHandle {
        GatewayHandle::new(self.slave)
    }

    /// Slave index of the gateway.
    #[inline]
    pub const fn slave(self) -> usize {
        self.slave
    }

    /// Channel of the gateway, 0 to 3.
    #[inline]
    pub const fn channel(self) -> u8 {
        self.channel
    }
}

impl fmt::Display for GatewayHandle {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "slave {}", self.slave)
    }
}

impl fmt::Display for ChannelHandle {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "slave {} channel {}", self.slave, self.channel)
    }
}

/// An address that the Port does not have.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum AddressError {
    /// No such slave.
    #[error("slave {slave} is out of range; the Port has {count} slave(s), counted from 0")]
    Slave {
        /// Slave index.
        slave: usize,
        /// Number of slaves in the Port.
        count: usize,
    },
    /// No such channel.
    #[error("slave {slave}: channel {channel} is out of range; allowed: 0 to {}", CHANNELS - 1)]
    Channel {
        /// Slave index.
        slave: usize,
        /// Channel.
        channel: u8,
    },
    /// The configuration does not enable the channel.
    #[error(
        "slave {slave}: channel {channel} is not enabled; enable it in the gateway's configuration"
    )]
    Disabled {
        /// Slave index.
        slave: usize,
        /// Channel.
        channel: u8,
    },
}
