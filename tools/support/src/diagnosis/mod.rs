//! Diagnosis of a gateway (manual 5.4.6, 16): findings with causes, most likely first, and the next
//! step.
//!
//! The crate does not access a device. [`Snapshot::read`] reads values through a function of the
//! caller; [`findings`] is a pure function of a snapshot, which can also come from a file.
//!
//! ```
//! use ecan_tool_support::diagnosis::{Snapshot, findings};
//!
//! let mut snapshot = Snapshot::default();
//! snapshot.set(0x8010, 2, 5);
//! let found = findings(&snapshot);
//! assert_eq!(found[0].id, "profile-mapping-reload");
//! ```
//!
//! Allocates; do not call in the cycle.

mod channel;
mod channel_bus;
mod channel_loss;
mod channel_setting;
mod finding;
mod gateway;
mod operation;
mod process_data;
pub mod registers;
mod snapshot;

pub use finding::{Finding, Location, Severity};
pub use gateway::{DIAGNOSTIC_FLAGS, findings, flag_names};
pub use snapshot::{Depth, ObjectKey, ReadError, Snapshot};
