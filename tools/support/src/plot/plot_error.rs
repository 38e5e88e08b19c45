use std::path::PathBuf;

use thiserror::Error;

/// Error of a picture.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum PlotError {
    /// The file cannot be written.
    #[error("cannot write {}: {source}; use a writable directory", path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// Error of the system.
        source: std::io::Error,
    },
    /// The picture cannot be drawn.
    #[error("cannot draw the picture: {reason}")]
    Draw {
        /// Error of the drawing library.
        reason: String,
    },
}

impl PlotError {
    /// An error of the drawing library.
    pub(crate) fn draw(error: impl std::fmt::Display) -> Self {
        Self::Draw { reason: error.to_string() }
    }
}
