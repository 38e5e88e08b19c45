//! Failure of a step of a node's configuration.

use std::fmt;
use std::time::Duration;

use ecan_protocol::sequence::{SdoValue, StepError};
use thiserror::Error;

use super::address::NodeAddress;
use super::node_action::Step;
use super::sdo_error::{SdoFault, SdoStartError};
use crate::NmtState;

/// Cause of the failure of a step.
pub type StepFault = StepError<NodeAccessError>;

/// Cause of the failure of a step.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum NodeAccessError {
    /// The transfer failed.
    #[error(transparent)]
    Sdo(#[from] SdoFault),
    /// The transfer could not start.
    #[error(transparent)]
    Start(#[from] SdoStartError),
    /// The boot-up message did not arrive in time.
    #[error("no boot-up message after {} ms", waited.as_millis())]
    NoBootUp {
        /// Waiting time.
        waited: Duration,
    },
    /// A parameter could not be written or read back.
    #[error("parameter 0x{index:04X}:{subindex:02X}: {fault}")]
    Parameter {
        /// Object index.
        index: u16,
        /// Object subindex.
        subindex: u8,
        /// Cause.
        fault: SdoFault,
    },
    /// The node has another value of a parameter than the one that was written.
    #[error("parameter 0x{index:04X}:{subindex:02X} = {expected} was written, {found} read back")]
    ParameterMismatch {
        /// Object index.
        index: u16,
        /// Object subindex.
        subindex: u8,
        /// Value that was read back; the first bytes of a long one.
        found: SdoValue,
        /// Value that was written; the first bytes of a long one.
        expected: SdoValue,
    },
    /// Neither heartbeat nor guarding response arrived in time.
    #[error("no heartbeat or guarding response after {} ms", waited.as_millis())]
    NoHeartbeat {
        /// Waiting time.
        waited: Duration,
    },
    /// The node did not report the state in time.
    #[error("after {} ms the node {}", waited.as_millis(), LastState(*reported))]
    State {
        /// State that the node reported last; `None` before its first report.
        reported: Option<NmtState>,
        /// Waiting time.
        waited: Duration,
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

/// Failure of a step, with its node and its position in the list.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[error("{address}, step {} of {of}, {step}: {fault}", *nth + 1)]
pub struct StepFailure {
    /// The node.
    pub address: NodeAddress,
    /// Index of the step, from 0.
    pub nth: usize,
    /// Number of steps.
    pub of: usize,
    /// The step.
    pub step: Step,
    /// Cause.
    pub fault: StepFault,
}

impl StepFailure {
    /// Returns whether the same step may succeed later without a change by the application.
    pub const fn is_temporary(&self) -> bool {
        match self.fault {
            StepError::Access(
                NodeAccessError::Sdo(fault) | NodeAccessError::Parameter { fault, .. },
            ) => fault.is_temporary(),
            StepError::Access(NodeAccessError::ParameterMismatch { .. }) => false,
            StepError::Access(NodeAccessError::Start(error)) => error.is_temporary(),
            StepError::Mismatch { .. } => false,
            _ => true,
        }
    }
}
