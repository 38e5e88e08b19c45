//! Device files: EDS and DCF (CiA 306-1).

mod contents;
mod deviations;
mod downloads;
mod foreign;
mod names;
mod python;
mod round_trip;
mod values;

use ecan_canopen::{DeviceFile, NodeId};

/// A file without deviations that uses everything.
const EVERYTHING: &str = include_str!("data/everything.dcf");

fn everything() -> DeviceFile {
    DeviceFile::parse(EVERYTHING.as_bytes()).unwrap()
}

fn node(id: u8) -> NodeId {
    NodeId::new(id).unwrap()
}
