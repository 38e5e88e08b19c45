//! libecan_mcan_host: the process data protocol of ECAN-Lite for C, without an EtherCAT master.
//!
//! The C headers `igh_ecan_common.h` and `igh_mcan_pdo.h` are generated from this crate: their
//! doc comments are the header's comments. They are written for readers of C; the head of the headers states the rules
//! for pointers. The C types that libecan_igh_host uses as well are in `ecan-c-boundary`.
#![deny(missing_docs)]
#![deny(clippy::print_stdout, clippy::print_stderr)]
#![allow(non_camel_case_types, reason = "the types have their C names")]
#![allow(clippy::missing_safety_doc, reason = "the header states the rules for all pointers")]

pub mod common;
pub mod parser;
pub mod writer;
