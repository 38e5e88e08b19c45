//! Failure of the boot-up of a node.

use std::time::Duration;

use ecan_protocol::sequence::{Action, StepError};
use thiserror::Error;

use super::boot_phase::BootPhase;
use super::parameter_error::ParameterError;
use crate::network::step_failure::StepFailure;
use crate::object;

/// Failure of the boot-up of a node.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum BootError {
    /// The node sent neither a boot-up message nor a response to an SDO request.
    #[error("no response after {} ms", waited.as_millis())]
    NoResponse {
        /// Waiting time.
        waited: Duration,
    },
    /// A step failed: identity, software, default parameters, PDO mapping, heartbeat or NMT state.
    #[error("{}: {}", failure.step, failure.fault)]
    Step {
        /// Phase of the boot-up.
        phase: BootPhase,
        /// The step and its failure.
        failure: StepFailure,
    },
    /// The parameters could not be written.
    #[error("parameters: {0}")]
    Parameters(ParameterError),
    /// The node restarted again and again.
    #[error("the node restarted {restarts} times during its boot-up")]
    Restarts {
        /// Number of restarts.
        restarts: u8,
    },
}

impl BootError {
    /// Error status of CiA 302-2, a letter from A to O.
    pub fn cia302_status(&self) -> char {
        match self {
            Self::NoResponse { .. } | Self::Restarts { .. } => 'B',
            Self::Parameters(_) => 'J',
            Self::Step { phase: BootPhase::Identity, failure } => identity_status(failure),
            Self::Step { phase: BootPhase::Start, .. } => 'K',
            Self::Step { .. } => 'J',
        }
    }

    /// Returns whether the boot-up may succeed later without a change by the application.
    pub fn is_temporary(&self) -> bool {
        match self {
            Self::NoResponse { .. } | Self::Restarts { .. } => true,
            Self::Step { failure, .. } => failure.is_temporary(),
            Self::Parameters(ParameterError::Transfer { fault, .. }) => fault.is_temporary(),
            Self::Parameters(_) => false,
        }
    }
}

fn identity_status(failure: &StepFailure) -> char {
    let key = match failure.step.action {
        Action::Expect { index, subindex, .. } => (index, subindex),
        _ => return 'B',
    };
    let is_mismatch = matches!(failure.fault, StepError::Mismatch { .. });
    match key {
        (object::DEVICE_TYPE, _) if is_mismatch => 'C',
        (object::IDENTITY, 1) => 'D',
        (object::IDENTITY, 2) => 'M',
        (object::IDENTITY, 3) => 'N',
        (object::IDENTITY, 4) => 'O',
        (object::PROGRAM_IDENTIFICATION, _) => 'H',
        _ => 'B',
    }
}
