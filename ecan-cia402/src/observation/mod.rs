//! The axes' part of a snapshot.

mod axes_snapshot;
mod codes;

pub use axes_snapshot::AxesSnapshot;

pub(crate) use axes_snapshot::{AxesWriter, reserve};
