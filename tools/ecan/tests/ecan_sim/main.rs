//! The program `ecan-sim` as a user runs it.
#![allow(missing_docs, clippy::disallowed_macros, clippy::disallowed_methods)]

mod misuse;
mod pysoem;
mod raw_master;
mod support;
mod variants;
