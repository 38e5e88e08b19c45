/// Error in an EDS.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("line {line}: {reason}")]
pub struct EdsError {
    /// Line, from 1.
    pub line: usize,
    /// Error text.
    pub reason: String,
}

impl EdsError {
    pub(super) fn new(line: usize, reason: impl Into<String>) -> Self {
        Self { line, reason: reason.into() }
    }
}
