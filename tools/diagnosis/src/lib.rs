//! The chapters on debugging and diagnosis of the manual (5.4.6, 16) as a library: from what a
//! gateway tells about itself to findings, with causes in the order of likelihood and the next
//! step.
//!
//! Nothing here talks to a device. [`Snapshot::read`] takes the values through a function of the
//! caller's, [`findings`] is a pure function of a snapshot; so a snapshot that was written to a
//! file elsewhere is explained in the same way.
//!
//! ```
//! use ecan_diagnosis::{Snapshot, findings};
//!
//! let mut snapshot = Snapshot::default();
//! snapshot.set(0x8010, 2, 5);
//! let found = findings(&snapshot);
//! assert_eq!(found[0].id, "profile-mapping-reload");
//! ```
//!
//! Allocates freely; not for the cycle.
#![deny(missing_docs)]
#![forbid(unsafe_code)]

mod bit_words;
mod diagnostic_flags;
mod finding;
mod findings;
pub mod registers;
mod snapshot;

pub use diagnostic_flags::{DIAGNOSTIC_FLAGS, flag_words};
pub use finding::{Finding, Location, Severity};
pub use findings::findings;
pub use snapshot::{Depth, ObjectKey, ReadError, Snapshot};
