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

/// Shared by `ecan`, `ecan-sim` and the example programs: options, interrupts, output files.
pub mod command_line {
    pub mod interrupt;
    pub mod log_file;
    pub mod new_file;
    pub mod options;
    pub mod run_info;
    pub mod screen;
}
pub mod diagnosis;
pub mod plot;
pub mod probe;
