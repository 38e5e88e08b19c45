//! Tests of the service; those that need a process of their own are separate.
#![allow(missing_docs)]

mod protocol;
mod server;
