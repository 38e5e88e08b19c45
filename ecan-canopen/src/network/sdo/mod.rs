//! The SDO client of one node (CiA 301, 7.2.4): expedited, segmented and block transfer.

mod client;
mod frames;

pub use client::{Sdo, SdoClient};
pub(super) use client::{SdoTurn, TurnState};
