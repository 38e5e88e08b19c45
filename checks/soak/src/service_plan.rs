//! The plan of a service with clients.

use fastrand::Rng;
use serde::{Deserialize, Serialize};

use crate::draw::pick;

/// A service with clients, in the form of the file that repeats a trial.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ServicePlan {
    /// 1 to 3.
    pub clients: u8,
    /// Bytes that wait for one client.
    pub queue_bytes: usize,
    /// Frames of a client and channel that may be without result.
    pub window: u32,
    /// Cycles in 100 in which a client acts.
    pub activity: u32,
    /// Most frames that a client sends when it acts.
    pub frames: u32,
}

impl ServicePlan {
    /// `has_drives`: little traffic in addition to the axes.
    pub fn draw(r: &mut Rng, has_drives: bool) -> Self {
        Self {
            clients: r.u8(1..=3),
            queue_bytes: pick(r, &[8_192, 65_536, 1 << 20]),
            window: pick(r, &[2, 16, 64]),
            activity: pick(r, &[1, 5, 20]),
            frames: if has_drives { 1 } else { pick(r, &[1, 4, 20]) },
        }
    }
}
