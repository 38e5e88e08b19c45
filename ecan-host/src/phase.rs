//! Phase of an Adapter.

use std::fmt;

/// Phase of an [`Adapter`](crate::Adapter).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Phase {
    /// Nothing is configured, because a reconfiguration failed. Call
    /// [`Adapter::reconfigure`](crate::Adapter::reconfigure) again, or drop the Adapter.
    Down,
    /// Slaves, domains and startup SDOs are configured; requests can be created.
    Configured,
    /// The master runs cyclically; the process data exist.
    Active,
}

impl fmt::Display for Phase {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Down => "down",
            Self::Configured => "configured",
            Self::Active => "active",
        })
    }
}
