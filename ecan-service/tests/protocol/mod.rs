//! Messages.

mod records;
mod rpc;
