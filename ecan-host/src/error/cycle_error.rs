//! Errors inside the cycle.

use ecrt_sys::Errno;
use thiserror::Error;

use crate::phase::Phase;

/// Errors inside the cycle: small, `Copy`, without allocation.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum CycleError {
    /// A call of the master library failed.
    #[error("{call}{} failed in the cycle: {errno}", Of(*slave))]
    Library {
        /// Name of the library function.
        call: &'static str,
        /// Slave index, if the call concerns one slave.
        slave: Option<usize>,
        /// Error number of the system.
        errno: Errno,
    },
    /// The Adapter is not active, so that there is no cycle.
    #[error(
        "the bus is {is}, not active; {}",
        if *is == Phase::Down {
            "the last reconfiguration failed: call reconfigure again"
        } else {
            "call activate first"
        }
    )]
    NotActive {
        /// Current phase.
        is: Phase,
    },
}

impl CycleError {
    /// Returns whether a later cycle can succeed without a change by the application: a call of the master
    /// library failed, on a bus that may recover.
    pub fn is_temporary(&self) -> bool {
        matches!(self, Self::Library { .. })
    }

    pub(crate) fn library(call: &'static str) -> impl Fn(Errno) -> Self {
        move |errno| Self::Library { call, slave: None, errno }
    }

    pub(crate) fn of_slave(call: &'static str, slave: usize) -> impl Fn(Errno) -> Self {
        move |errno| Self::Library { call, slave: Some(slave), errno }
    }
}

struct Of(Option<usize>);

impl std::fmt::Display for Of {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        self.0.map_or(Ok(()), |slave| write!(f, " of slave {slave}"))
    }
}
