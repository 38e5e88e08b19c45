//! One experiment, and the stages in which experiments run.

use serde::Serialize;

use crate::interruption::Result;
use crate::outcome::Outcome;
use crate::probe::Probe;

/// Stage of the probe, in their order.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Stage {
    /// Reads objects in the present state of the gateway.
    Reading,
    /// Configures the gateway in PREOP; restarts it once.
    PreOp,
    /// Exchanges images without frames in OP.
    Op,
    /// Sends frames in the internal loopback of the CAN controller.
    Loopback,
    /// Sends frames between two wired channels.
    Wired,
}

impl Stage {
    /// Every stage, in order.
    pub const ALL: [Self; 5] = [Self::Reading, Self::PreOp, Self::Op, Self::Loopback, Self::Wired];

    /// Description for people.
    pub fn text(self) -> &'static str {
        match self {
            Self::Reading => "reading",
            Self::PreOp => "configuration in PREOP",
            Self::Op => "OP with empty images",
            Self::Loopback => "loopback inside the controller",
            Self::Wired => "frames between wired channels",
        }
    }
}

/// Experiment that decides one assumption.
#[derive(Clone, Copy)]
pub struct Experiment {
    /// Rows of docs/ASSUMPTIONS.md.
    pub rows: &'static [&'static str],
    /// Switch of the simulator that the rows name; empty without one.
    pub key: &'static str,
    /// Stage.
    pub stage: Stage,
    /// The assumption.
    pub assumption: &'static str,
    pub(crate) run: fn(&mut Probe) -> Result<Outcome>,
}

impl std::fmt::Debug for Experiment {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Experiment").field("rows", &self.rows).field("key", &self.key).finish()
    }
}
