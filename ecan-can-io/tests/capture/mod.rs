//! pcapng files.

mod allocation;
mod golden;
mod recorder;
mod tshark;
