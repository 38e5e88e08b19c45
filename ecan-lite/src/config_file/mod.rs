//! One TOML file that describes the gateways of a bus, for applications and tools (manual 5.4.3,
//! 13.2 to 13.4, 14).
//!
//! ```
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! # let directory = tempfile::tempdir()?;
//! # let path = directory.path().join("cell.toml");
//! # std::fs::write(&path, ecan_lite::config::EXAMPLE)?;
//! # use ecan_sim::{EcrtSetting, SimOptions};
//! # let setting = EcrtSetting::resolve(Some("sim"))?;
//! # let ecrt = ecan_sim::open(&setting, &SimOptions::default())?.ecrt;
//! // `ecrt` is the loaded library, `path` the file.
//! let file = ecan_lite::config::load(path)?;
//! let port = ecan_mcan_port::Port::open(&ecrt, (file.adapter, file.port))?;
//! assert_eq!(port.slave_count(), 1);
//! # Ok(()) }
//! ```
//!
//! [`EXAMPLE`] is such a file with every key in it. An unknown key is a fault, and so is a value that
//! the gateway would reject; all faults are reported together, with line and column.
//!
//! The content of a file is a [`Config`]; `startup_sdo` tables are in its
//! [`startup`](ecan_host::AdapterConfig::startup) SDOs. CiA 402 axes, with their limits in rad/s, are
//! read by [`load_axes`]; they are part of no startup list, since the host configures drives over CAN. [`apply`] writes it to a gateway,
//! [`differences`] compares, [`FlashCommand::run`] saves it in the flash of the gateway, and
//! [`export`] makes startup lists for other masters. All of these block and allocate: do not call
//! them in the cycle.

mod axis;
mod bus;
mod compare;
mod device;
mod device_profile;
mod document;
pub mod export;
mod fault;
mod fields;
mod gateway;
mod load;
mod network;
mod node;
mod schema;

pub use bus::ServiceSettings;
pub use compare::{Difference, Expected, differences, missing_entries};
pub use device::{ConfigChecksums, FlashCommand, ResolveError, ResolvedGateway, apply, find};
pub use device_profile::{DeviceProfile, IncludedProfile, ProfileEffect};
pub use document::read_bytes;
pub use fault::{ConfigFileError, FileFault, FileFaults};
pub use load::{
    load, load_axes, load_axis_names, load_ecrt_options, load_network, load_network_settings,
    load_nodes, load_notes, load_profiles, load_service, parse, parse_axes, parse_with, startup,
};
pub use network::NetworkSettings;
pub use node::parse_bus_yml;
pub use schema::{EXAMPLE, INIT, schema};
