//! Frames of the layer setting services, LSS (CiA 305).

mod fastscan;
mod lss;

pub use fastscan::{Fastscan, FastscanFilter, FastscanStep};
pub use lss::{
    LssAddress, LssAddressRange, LssBitRate, LssConfirmation, LssPart, LssRequest, LssResponse,
    RangePart,
};

/// Node-ID of a slave without node-ID (CiA 305): it takes part in LSS only.
pub const UNCONFIGURED_NODE_ID: u8 = 0xFF;
