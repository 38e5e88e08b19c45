//! What the programs of the SDK share.
//!
//! | module | contents |
//! | --- | --- |
//! | [`command_line`] | output without control characters, logging, signals, output files, real-time options |
//! | [`diagnosis`] | findings of chapter 16 of the manual in the objects of a gateway |
//! | [`plot`] | pictures of axes, clocks and histograms |
//! | [`probe`] | experiments that decide the assumptions about a gateway |
#![deny(missing_docs)]
#![forbid(unsafe_code)]

pub mod command_line;
pub mod diagnosis;
pub mod plot;
pub mod probe;
