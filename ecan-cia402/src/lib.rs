//! CANopen and CiA 402 axes over an MCAN Port, in two layers.
//!
//! # Layer 1: CANopen (CiA 301)
//!
//! A [`Network`] is the master of all nodes behind the gateways of a
//! [`Port`](ecan_mcan_port::Port): NMT, boot-up messages and heartbeats, EMCY, SYNC, and an SDO
//! client per node. It is driven by the cycle and never blocks; a [`Configurator`] brings many
//! nodes up at once by lists of [`Step`]s, a [`PdoMapping`] gives the steps that map a PDO. The
//! calls that end in `_blocking` run the cycle themselves.
//!
//! ```no_run
//! use ecan_canopen::NodeId;
//! use ecan_cia402::{Network, NetworkConfig, NodeAddress, NodeConfig};
//!
//! fn device_type(port: &mut ecan_mcan_port::Port) -> Result<Vec<u8>, Box<dyn std::error::Error>> {
//!     let node = NodeId::new(1).ok_or("no node-ID")?;
//!     let mut network = Network::new(NetworkConfig::default());
//!     let address = NodeAddress { slave: 0, channel: 0, node };
//!     let drive = network.add_node(address, NodeConfig::default())?;
//!     Ok(network.upload_blocking(port, drive, (0x1000, 0), 2_000)?)
//! }
//! ```
//!
//! # Layer 2: CiA 402
//!
//! A [`Cia402`] drives a table of axes over such a network: start-up, state machine, modes, homing,
//! and targets in every cycle. A [`MotionGuard`] per axis keeps it from jumping; its documentation
//! says what happens to targets in which case.
#![deny(missing_docs)]
#![forbid(unsafe_code)]

mod canopen;

pub use canopen::*;

mod axis;

pub use axis::*;
