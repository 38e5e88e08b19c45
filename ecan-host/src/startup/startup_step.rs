//! One step of a slave's startup.

use ecan_protocol::object::SdoWrite;
use ecan_protocol::sequence::{Expectation, Step};

/// One step of a slave's startup: a [`Step`] that every EtherCAT master can execute or export.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum StartupStep {
    /// Writes an object. Registered with the master, which sends it in PREOP whenever it configures
    /// the slave.
    Download(SdoWrite),
    /// Reads an object and fails if it has another value: a capability, or the readback of an apply
    /// command. Executed before the bus is active if it leads the startup, or if the application added
    /// it; in that case the slave's whole startup is executed then, which takes tens of milliseconds
    /// for each SDO. Not executed when the master configures the slave again.
    Expect {
        /// Object index.
        index: u16,
        /// Object subindex.
        subindex: u8,
        /// Condition on its value.
        expected: Expectation,
    },
}

impl From<SdoWrite> for StartupStep {
    fn from(write: SdoWrite) -> Self {
        Self::Download(write)
    }
}

impl From<StartupStep> for Step {
    fn from(step: StartupStep) -> Self {
        match step {
            StartupStep::Download(write) => write.into(),
            StartupStep::Expect { index, subindex, expected } => {
                Self::expect_that(index, subindex, expected)
            }
        }
    }
}

impl Default for StartupStep {
    fn default() -> Self {
        Self::Download(SdoWrite::default())
    }
}

impl StartupStep {
    /// A step that expects an object to have this value.
    pub fn expect(index: u16, subindex: u8, value: u32) -> Self {
        Self::Expect { index, subindex, expected: Expectation::Equals(value.into()) }
    }

    /// Index and subindex of the object.
    pub fn object(&self) -> (u16, u8) {
        match self {
            Self::Download(sdo) => (sdo.index, sdo.subindex),
            Self::Expect { index, subindex, .. } => (*index, *subindex),
        }
    }

    /// Returns whether the step writes.
    pub fn is_download(&self) -> bool {
        matches!(self, Self::Download(_))
    }
}
