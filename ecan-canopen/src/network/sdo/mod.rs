//! The SDO client of one node (CiA 301, 7.2.4): expedited, segmented and block transfer.

mod client;
mod incoming;
mod outgoing;
mod transfer;

pub use client::{Sdo, SdoClient};
