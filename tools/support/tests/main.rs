//! Tests of the parts that programs share.
#![allow(missing_docs, clippy::disallowed_macros, clippy::disallowed_methods)]

mod diagnosis;
mod plot;
mod probe;
