//! Frames of the layer setting services, LSS (CiA 305).

mod fastscan;
mod lss_address;
mod lss_bit_rate;
mod lss_request;
mod lss_response;

pub use fastscan::{Fastscan, FastscanFilter, FastscanStep};
pub use lss_address::{LssAddress, LssAddressRange, LssPart};
pub use lss_bit_rate::LssBitRate;
pub use lss_request::{LssRequest, RangePart};
pub use lss_response::{LssConfirmation, LssResponse};

/// Node-ID of a slave without node-ID (CiA 305): it takes part in LSS only.
pub const UNCONFIGURED_NODE_ID: u8 = 0xFF;
