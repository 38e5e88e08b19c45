//! Gateway and channel of a lane of the bridge.

use std::fmt;

use serde::Serialize;

/// A channel of a gateway, in the order of the command.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct LaneId {
    pub gateway: usize,
    pub channel: u8,
}

impl fmt::Display for LaneId {
    /// For example "can1", or "can1 of gateway 2".
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "can{}", self.channel)?;
        match self.gateway {
            0 => Ok(()),
            gateway => write!(f, " of gateway {gateway}"),
        }
    }
}
