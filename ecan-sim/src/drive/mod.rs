//! A CiA 402 drive: what a motor behind the gateway looks like from the bus.
//!
//! From below: `dictionary` (filled by `default_objects` or `eds`), `sdo_server` and `sdo_block`,
//! `pdo` with `pdo_rules`, `network` (NMT and heartbeats), `emergency`; `motor`, `ramp`, `homing`,
//! `motion` and the state machine `power` make up an `axis`; `device` (with `process_data` and
//! `object_access`) holds them together and `bus_node` puts it on the bus.

mod axis;
mod axis_commands;
mod bus_node;
mod data_type;
mod default_objects;
mod device;
mod dictionary;
mod eds;
mod emergency;
mod history;
mod homing;
mod identifiers;
mod ini;
mod motion;
mod motor;
mod network;
mod object_access;
mod parameters;
mod pdo;
mod pdo_rules;
mod power;
mod process_data;
mod ramp;
mod sdo_block;
mod sdo_server;
mod settings;
mod slots;

pub use bus_node::Drive;
pub use eds::{EdsError, EdsProblem};
pub use history::{TargetHistory, TargetKind, TargetRecord, TargetSums};
pub use settings::{DriveConfig, DriveQuirks, MotorConfig, SdoDirection, SdoEffect, SdoRule};
