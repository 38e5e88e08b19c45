//! What went wrong in a step.

use std::fmt;

use crate::NmtState;
use thiserror::Error;

use super::address::NodeAddress;
use super::error::{SdoFault, SdoStartError};
use super::step::Step;

/// What went wrong in a step.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum StepFault {
    /// The transfer failed.
    #[error(transparent)]
    Sdo(#[from] SdoFault),
    /// The transfer could not start.
    #[error(transparent)]
    Start(#[from] SdoStartError),
    /// The object reads another value.
    #[error(
        "reads 0x{found:X}, expected 0x{expected:X}{}",
        if *mask == u64::MAX { "" } else { " in the bits that count" }
    )]
    Mismatch {
        /// What was read.
        found: u64,
        /// What was expected.
        expected: u64,
        /// Bits that count.
        mask: u64,
    },
    /// The boot-up message did not come.
    #[error("no boot-up message after {waited_ms} ms")]
    NoBootUp {
        /// How long was waited, in milliseconds.
        waited_ms: u64,
    },
    /// The node did not report the state.
    #[error("after {waited_ms} ms the node {}", LastState(*reported))]
    State {
        /// What it reported last, if anything.
        reported: Option<NmtState>,
        /// How long was waited, in milliseconds.
        waited_ms: u64,
    },
}

struct LastState(Option<NmtState>);

impl fmt::Display for LastState {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0 {
            Some(state) => write!(f, "is still in state {state}"),
            None => f.write_str("has not reported a state"),
        }
    }
}

/// A configuration that failed, and where.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[error("{address}, step {} of {of}, {step}: {fault}", *nth + 1)]
pub struct StepFailure {
    /// The node.
    pub address: NodeAddress,
    /// Which step, from 0.
    pub nth: usize,
    /// How many there are.
    pub of: usize,
    /// The step.
    pub step: Step,
    /// What went wrong.
    pub fault: StepFault,
}
