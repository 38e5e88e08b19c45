//! The boundary between C and Rust: no panic crosses it, every pointer is checked for NULL, and
//! every error stores its text. Methods that take pointers return `ECAN_ERR_NULL` for NULL if the
//! length is not 0.

mod call;
mod mirror;
mod out_pointer;
mod sealed;

pub use call::{Call, ToResult, call, code_getter, getter, getter_or};
pub use out_pointer::{OutArray, OutPointer, put_text};
pub use sealed::Opaque;
