//! The boundary between C and Rust, and the C types that both C libraries use.
//!
//! No panic crosses the boundary, every pointer is checked for NULL, and every error stores its
//! text. Methods that take pointers return `ECAN_ERR_NULL` for NULL if the length is not 0.
//!
//! This crate exports no function, so that a program may contain it more than once. The last error
//! of a thread is in libecan_mcan_host only: a program that uses this crate links
//! `ecan-mcan-host`.
#![deny(missing_docs)]
#![deny(clippy::print_stdout, clippy::print_stderr)]
#![allow(non_camel_case_types, reason = "the types have their C names")]

mod call;
mod mirror;

pub mod frames;
pub mod image;
pub mod result;

pub use call::{
    Call, Opaque, OutText, RESERVED_IS_SET, ToResult, call, code_getter, getter, getter_or,
    put_text,
};
pub use result::{OutArray, OutPointer};
