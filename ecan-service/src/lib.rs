//! Many programs on one ECAN-Lite bus (docs/SERVICE.md).
//!
//! | module | contents | feature |
//! | --- | --- | --- |
//! | [`protocol`] | messages between a service and its clients | |
//! | [`client`](mod@client) | connection of another program to a service | `client` |
//! | [`server`](mod@server) | service in the process that runs the cycle | `server` |
#![deny(missing_docs)]
#![deny(clippy::print_stdout, clippy::print_stderr)]
#![forbid(unsafe_code)]

#[cfg(feature = "client")]
pub mod client;
pub mod protocol;
#[cfg(feature = "server")]
pub mod server;
