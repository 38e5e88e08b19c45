//! Formats and protocols of the CAN side, for programs beside the bus.
//!
//! | module | contents | feature |
//! | --- | --- | --- |
//! | [`candump`] | logs, screens and filters of candump, frames of cansend | |
//! | [`capture`] | pcapng files with CAN frames and PDO images, for Wireshark | |
//! | [`recording`](mod@recording) | recordings in the formats candump, Vector ASC and PEAK TRC | `recording` |
//! | [`dbc`] | signals as a DBC file describes them | `dbc` |
//! | [`bridge`] | slcan and socketcand servers, slcan on a pseudo-terminal, CAN interfaces of Linux | `bridge`, `socketcan` |
#![deny(missing_docs)]
#![forbid(unsafe_code)]

#[cfg(feature = "bridge")]
pub mod bridge;
pub mod candump;
pub mod capture;
#[cfg(feature = "dbc")]
pub mod dbc;
#[cfg(feature = "recording")]
pub mod recording;
