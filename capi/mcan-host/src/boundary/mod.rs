//! The boundary between C and Rust: no panic crosses it, every pointer is checked for NULL, and
//! every error leaves its words behind.

mod call;
mod mirror;
mod places;
mod sealed;

pub use call::{Call, ToResult, call, getter};
pub use places::{OutArray, OutPointer, put_text};
pub use sealed::{Plain, Sealed};
