//! Early end of a step.

use std::path::Path;

/// Early end of a step.
#[derive(Debug, thiserror::Error)]
pub enum Stop {
    /// The behaviour differs from the expected one.
    #[error("{0}")]
    Failed(String),
    /// The step does not apply.
    #[error("skipped: {0}")]
    Skipped(String),
    /// By the user.
    #[error("interrupted")]
    Interrupted,
}

impl Stop {
    pub fn failed(message: impl Into<String>) -> Self {
        Self::Failed(message.into())
    }

    /// A file that cannot be read or written.
    pub fn file(path: &Path, error: &std::io::Error) -> Self {
        Self::Failed(format!("{}: {error}", path.display()))
    }
}

/// Fails with the message unless the condition holds.
pub fn check(condition: bool, message: impl FnOnce() -> String) -> Result<(), Stop> {
    if condition { Ok(()) } else { Err(Stop::Failed(message())) }
}
