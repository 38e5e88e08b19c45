//! libecan_igh_host: the whole SDK for C.
//!
//! The headers `igh_adapter.h`, `igh_mcan_port.h`, `igh_cia402_protocol.h` and `igh_canopen.h` are generated
//! from this crate; its doc comments are the header's comments, written for readers of C. A source file is a
//! section of a header, or has several, each of which begins with a comment `Section: TITLE`.
//!
//! A context of C is a few words that name a `bus` in a table of slots; they are checked before any
//! access (`handle`).
#![deny(missing_docs)]
#![deny(clippy::print_stdout, clippy::print_stderr)]
#![allow(non_camel_case_types, reason = "the types have their C names")]
#![allow(clippy::missing_safety_doc, reason = "the header states the rules for all pointers")]

mod bus;
mod callback;
mod encoded;
mod errors;
mod guard;
mod handle;
#[cfg(all(test, feature = "sim"))]
mod test_caller;

pub mod adapter;
pub mod canopen;
pub mod cia402;
pub mod mcan_port;
pub mod observer;
pub mod plan;

// The tests link its functions.
#[cfg(test)]
use ecan_mcan_host as _;
