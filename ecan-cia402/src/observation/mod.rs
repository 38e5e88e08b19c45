//! The axes' part of a snapshot.

pub(crate) mod axis_status;
mod codes;

pub use axis_status::{AxesSnapshot, AxisStatus};
pub(crate) use axis_status::{AxesWriter, reserve};
