//! The axes' part of a snapshot.

mod axes_snapshot;
pub(crate) mod axis_status;
mod codes;

pub use axes_snapshot::AxesSnapshot;
pub use axis_status::AxisStatus;

pub(crate) use axes_snapshot::{AxesWriter, reserve};
