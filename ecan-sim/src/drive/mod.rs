//! A simulated CiA 402 drive.
//!
//! `dictionary` (filled by `objects`), `sdo_server`, `pdo`, `network` (NMT, heartbeats, guarding, emergencies) and `lss` are
//! its CANopen side; `motor`, `parameters`, `homing`, `motion` and the state machine `power` form an `axis`, whose
//! events `trace` records; `axis_unit` has all of a drive. `model` joins objects and axes; `device` adds
//! `process_data`, SDO access (`object_access`) and the supply, and `bus_node` connects it to the bus.

mod axis;
mod axis_commands;
mod bus_node;
mod config;
mod device;
mod dictionary;
mod homing;
mod model;
mod motion;
mod motor;
mod network;
mod object_access;
mod objects;
mod parameters;
mod pdo;
mod power;
mod process_data;
mod sdo_server;
mod trace;

pub use bus_node::{Drive, DriveAxis};
pub use config::{DriveConfig, DriveQuirks, MotorConfig, SdoDirection, SdoEffect, SdoRule};
pub(crate) use pdo::StandardIds;
pub use trace::{
    CommandSource, DriveTrace, MotionSample, TargetHistory, TargetKind, TargetRecord, TargetSums,
    TraceCause, TraceEvent, TraceRecord,
};
