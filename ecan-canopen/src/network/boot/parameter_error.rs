//! Failure to write a parameter set.

use ecan_protocol::sequence::SdoValue;
use thiserror::Error;

use super::parameter::Subject;
use crate::network::sdo_error::{SdoFault, SdoStartError};

/// Failure to write a [`ParameterSet`](super::ParameterSet).
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum ParameterError {
    /// A transfer failed.
    #[error("{}: {fault}", text(subject))]
    Transfer {
        /// The object.
        subject: Option<Subject>,
        /// Cause.
        fault: SdoFault,
    },
    /// A transfer could not start.
    #[error("{}: {error}", text(subject))]
    Start {
        /// The object.
        subject: Option<Subject>,
        /// Cause.
        error: SdoStartError,
    },
    /// The node has another value than the one that was written.
    #[error("{subject} = {expected} was written, {found} read back")]
    Mismatch {
        /// The object.
        subject: Subject,
        /// Value that was read back; the first bytes of a long one.
        found: SdoValue,
        /// Value that was written; the first bytes of a long one.
        expected: SdoValue,
    },
}

fn text(subject: &Option<Subject>) -> String {
    subject.as_ref().map_or_else(|| "object".to_owned(), ToString::to_string)
}
