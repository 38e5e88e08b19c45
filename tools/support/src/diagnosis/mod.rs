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

mod bit_names;
mod diagnostic_flags;
mod finding;
mod findings;
pub mod registers;
mod snapshot;

pub use diagnostic_flags::{DIAGNOSTIC_FLAGS, flag_names};
pub use finding::{Finding, Location, Severity};
pub use findings::findings;
pub use snapshot::{Depth, ObjectKey, ReadError, Snapshot};
