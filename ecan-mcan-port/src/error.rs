//! Errors of the Port outside the cycle.

use std::fmt;

use ecan_host::{CycleError, Faults};
use ecan_protocol::mapping::CHANNELS;
use thiserror::Error;

use crate::config_check::PortConfigFault;
use crate::session::machine::Session;
use crate::session::verification::{PendingStep, VerificationFault};

/// Errors of the Port outside the cycle.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum PortError {
    /// The configuration has faults; nothing was touched.
    #[error(transparent)]
    Config(#[from] Faults<PortConfigFault>),
    /// The Adapter failed.
    #[error(transparent)]
    Adapter(#[from] ecan_host::Error),
    /// The cycle failed while waiting.
    #[error(transparent)]
    Cycle(#[from] CycleError),
    /// The Port does not have this address.
    #[error(transparent)]
    Address(#[from] AddressError),
    /// A gateway is in OP but not ready in time.
    #[error(
        "slave {slave} is {session} after {waited_ms} ms{}",
        details(*session, *waiting_for, *last_fault)
    )]
    NotReady {
        /// Slave index.
        slave: usize,
        /// State of its session.
        session: Session,
        /// Step that it waits for; `None` if its verification fails by a value that does not change.
        waiting_for: Option<PendingStep>,
        /// Fault of its last verification that failed.
        last_fault: Option<VerificationFault>,
        /// Time waited, in milliseconds.
        waited_ms: u64,
    },
}

impl PortError {
    /// Returns whether the cause may pass by itself, so that the same call can succeed later.
    pub fn is_temporary(&self) -> bool {
        match self {
            Self::NotReady { last_fault, .. } => {
                !matches!(last_fault, Some(VerificationFault::NodeMode { .. }))
            }
            Self::Adapter(error) => error.is_temporary(),
            Self::Cycle(error) => error.is_temporary(),
            _ => false,
        }
    }
}

/// Step that a gateway waits for, and the last fault unless the session contains it.
fn details(
    session: Session,
    waiting_for: Option<PendingStep>,
    last_fault: Option<VerificationFault>,
) -> String {
    let mut text = waiting_for.map_or_else(String::new, |step| format!("; it waits for {step}"));
    if let Some(fault) = last_fault
        && session != Session::Failed(fault)
    {
        text.push_str(&format!("; the last attempt failed: {fault}"));
    }
    text
}

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
