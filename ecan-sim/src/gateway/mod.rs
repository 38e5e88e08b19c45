//! Firmware model of one ECAN-Lite gateway.
//!
//! A [`Gateway`] has no Ethernet frames: a front end (a simulated libethercat, or a slave controller
//! on the wire) passes AL requests, mailbox transfers and complete sync manager accesses, and the
//! world connects its four channels to CAN buses. The caller passes the time, in simulated
//! nanoseconds; it must not run backwards. Equal calls with an equal seed give equal results.
//!
//! "A cycle" of the budgets of 0x8021..0x8024 is an assumption of this model: one data-path service
//! per complete SM2 write, `service_delay_ns` after it, and in SAFEOP one more per
//! `idle_service_ns`. A service parses the image, hands frames from the TX rings to the controllers,
//! drains the controllers into the RX caches, and builds the next TxPDO if SM3 is empty. Nothing in
//! it allocates.
//!
//! Points that the manual leaves open are switches, declared in [`variant`].
//!
//! The parts: `EthercatSide` is the slave controller, `Application` is the firmware with its objects, its data
//! path and its CAN connectors, and `ObjectAccess` serves SDOs. The configuration store, the firmware
//! partitions and the EEPROM survive power loss.

mod al_state;
mod application;
mod channel;
mod channel_control;
mod config;
mod configuration_image;
mod configuration_store;
mod controller;
mod data_path;
mod dc_clock;
mod diagnostics;
mod dictionary_values;
mod ethercat_side;
mod fault;
mod firmware_update;
mod maintenance;
mod mcan_registers;
mod message_ram;
mod model;
mod object_access;
mod object_server;
mod pdo;
mod profile_control;
mod receive_path;
mod sync_managers;
mod transmit_path;
pub mod variant;

pub(crate) use config::MAILBOXES;
pub use config::{GatewayModelConfig, Sync0, Sync0Window, SyncManagerConfig};
pub(crate) use diagnostics::Emergency;
pub use diagnostics::{GatewayCounters, ReceiveLosses, TransmitLosses};
pub use firmware_update::{
    FirmwarePackage, FirmwarePackageError, FirmwareProgress, FirmwareUpdateError,
};
pub use model::Gateway;
pub(crate) use object_access::{DEVICE_NAME, ObjectAccess, check_complete_access, find_entry};

const NS_PER_MS: u64 = 1_000_000;
