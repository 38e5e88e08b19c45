//! Tests of the gateways on a wire.

mod clock;
mod copy;
mod mailbox;
mod maintenance;
mod process_data;
mod registers;
mod robustness;
mod trace;
