//! CANopen (CiA 301, CiA 305) and the objects of CiA 402: frames as types, and a CANopen master over an
//! MCAN Port.
//!
//! # Frames
//!
//! COB-IDs, NMT, heartbeat, node guarding, EMCY, SYNC, TIME, SDO, PDO mapping, MPDO, LSS, controlword,
//! statusword and modes.
//! `no_std`, without allocation and without I/O. The host's CANopen master and the simulated drive
//! both use it, so every byte is defined once. Decoders take the data bytes of a CAN frame and
//! return a value or a typed error, for any input.
//!
//! # Network
//!
//! With the feature `network` (requires `std`), `Network` is the master of all nodes that are
//! connected to the gateways of a Port: NMT, boot-up messages, heartbeats or node guarding, EMCY, SYNC,
//! TIME, one LSS master per channel, and one SDO client per node. The cycle drives it; it never blocks. A
//! `Configurator` configures many nodes at once from lists of `Step`s; a `PdoMapping` returns the steps that
//! map a PDO. The calls of `Network::blocking` run the cycle themselves.
//!
//! ```no_run
//! # #[cfg(feature = "network")]
//! # mod example {
//! use std::time::Duration;
//!
//! use ecan_canopen::{Network, NetworkConfig, NodeAddress, NodeConfig, NodeId};
//!
//! fn device_type(port: &mut ecan_mcan_port::Port) -> Result<Vec<u8>, Box<dyn std::error::Error>> {
//!     let node = NodeId::new(1)?;
//!     let mut network = Network::new(NetworkConfig::default());
//!     let address = NodeAddress { slave: 0, channel: 0, node };
//!     let drive = network.add_node(address, NodeConfig::default())?;
//!     Ok(network.blocking(port, Duration::from_secs(2)).upload(drive, (0x1000, 0))?)
//! }
//! # }
//! ```
//!
//! # Device files
//!
//! With the feature `device-files` (requires an allocator), a `DeviceFile` holds the contents of an EDS
//! or a DCF (CiA 306-1): it reads them with all deviations of real files as warnings, finds entries
//! by name, converts values between text and the bytes of an SDO, lists the downloads that configure a
//! node, and writes the file again.
//!
//! ```
//! # #[cfg(feature = "device-files")]
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! use ecan_canopen::{DeviceFile, DownloadScope, NodeId};
//!
//! let text = "[1017]\nParameterName=Heartbeat\nDataType=6\nAccessType=rw\nParameterValue=100\n";
//! let file = DeviceFile::parse(text.as_bytes())?;
//! for warning in file.warnings() {
//!     eprintln!("{warning}");
//! }
//! let node = NodeId::new(5)?;
//! let heartbeat = file.find("heartbeat")?;
//! assert_eq!(heartbeat.parameter_value(node).map(|value| value.to_string()), Some("100".into()));
//! let downloads = file.downloads(node, DownloadScope::Changed)?;
//! assert_eq!((downloads[0].index, &*downloads[0].data), (0x1017, &[100, 0][..]));
//! # Ok(())
//! # }
//! # #[cfg(not(feature = "device-files"))]
//! # fn main() {}
//! ```
#![cfg_attr(not(feature = "network"), no_std)]
#![deny(missing_docs)]
#![deny(clippy::print_stdout, clippy::print_stderr)]
#![forbid(unsafe_code)]

#[cfg(feature = "device-files")]
extern crate alloc;

mod cia301;
mod cia305;
mod cia402;
#[cfg(feature = "device-files")]
mod device_file;
pub mod object;

pub use cia301::*;
pub use cia305::*;
pub use cia402::*;
#[cfg(feature = "device-files")]
pub use device_file::*;

#[cfg(feature = "network")]
mod network;

#[cfg(feature = "network")]
pub use network::*;
