//! The process data protocol: `igh_mcan_pdo.h`.

pub mod channel_status;
pub mod diagnosis;
pub mod parser;
pub mod profile;
pub mod tools;
pub mod tx_frames;
pub mod writer;
