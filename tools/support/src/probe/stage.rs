//! Stages in which the experiments run.

use serde::Serialize;

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
