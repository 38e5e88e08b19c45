//! A simulated CiA 402 drive.
//!
//! `dictionary` (filled by `default_objects` or `file_objects`), `sdo_server` with `sdo_block`, `pdo` with
//! `pdo_rules`, `mpdo` and `scanner_list`, `network` (NMT and heartbeats), `guarding`, `lss_slave` with `layer_settings`,
//! and `emergency` are its CANopen side; `motor`, `ramp`,
//! `homing`, `motion` and the state machine `power` form an `axis`, whose events `trace` records; `axis_unit` has all of a drive. `device` (with `process_data` and
//! `object_access`) contains both sides, and `bus_node` connects it to the bus.

mod axis;
mod axis_commands;
mod axis_objects;
mod axis_unit;
mod bus_node;
mod can_id_set;
mod config;
mod default_objects;
mod device;
mod dictionary;
mod drive_axis;
mod emergency;
mod file_objects;
mod guarding;
mod history;
mod homing;
mod layer_settings;
mod lss_slave;
mod motion;
mod motor;
mod mpdo;
mod network;
mod object_access;
mod object_source;
mod parameters;
mod pdo;
mod pdo_rules;
mod power;
mod process_data;
mod ramp;
mod rounding;
mod scanner_list;
mod sdo_block;
mod sdo_server;
mod standard_ids;
mod touch_probe;
mod trace;
mod updated_object;

pub use bus_node::Drive;
pub use config::{DriveConfig, DriveQuirks, MotorConfig, SdoDirection, SdoEffect, SdoRule};
pub use drive_axis::DriveAxis;
pub use history::{TargetHistory, TargetKind, TargetRecord, TargetSums};
pub(crate) use standard_ids::StandardIds;
pub use trace::{CommandSource, DriveTrace, MotionSample, TraceCause, TraceEvent, TraceRecord};
