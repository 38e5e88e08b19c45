//! Host SDK of ECAN-Lite, an EtherCAT gateway with four CAN / CAN FD channels: the crate that
//! applications import.
//!
//! | module | contents |
//! | --- | --- |
//! | [`adapter`] | EtherCAT master, OP, process data, SDOs, distributed clocks, real-time cycle |
//! | [`can`] | frames, and the [`Port`](can::Port) that sends, receives and schedules them |
//! | [`config`] | everything that a user describes |
//! | `canopen`, `cia402` | CANopen network and CiA 402 axes (feature `cia402`) |
//! | `sim` | scenarios and faults of the built-in simulator (feature `sim`, on by default) |
//! | [`prelude`] | the names of a usual program |
//!
//! The environment variable `ECAN_ECRT` selects the EtherCAT master library: unset for the installed
//! libethercat, `sim` for the built-in simulator, or the path of a library.
//!
//! ```no_run
#![doc = include_str!("../examples/first_program.rs")]
//! ```
//!
//! # Features
//!
//! - `sim` (default): the built-in simulator.
//! - `config-file`: `config::load` reads gateways, channels and cycle from a TOML file.
//! - `cia402`: the modules `canopen` and `cia402`.
#![deny(missing_docs)]
#![forbid(unsafe_code)]

#[cfg(feature = "config-file")]
mod config_file;
mod error;
mod open;
mod plan_table;

pub use error::{Error, Result};
#[cfg(feature = "cia402")]
pub use open::open_axes;
pub use open::{EcrtOptions, OpenEcrt, OpenedEcrt, open};
pub use plan_table::plan_table;

/// EtherCAT master, domains, startup SDOs, distributed clocks and real-time cycle (manual 15.5.2).
pub mod adapter {
    pub use ecan_host::*;
}

/// CAN frames, and the Port that sends, receives and schedules them (manual 15.4).
pub mod can {
    pub use ecan_mcan_port::*;
    pub use ecan_protocol::can::*;
    pub use ecan_protocol::image::{ChannelState, ChannelStatus, ResultCode, Schedule, Timestamp};
}

/// CANopen network: NMT, SDO, PDO, SYNC, EMCY (CiA 301).
#[cfg(feature = "cia402")]
pub mod canopen {
    pub use ecan_canopen::*;
}

/// CiA 402 axes on a CANopen network (manual 15.5.4).
#[cfg(feature = "cia402")]
pub mod cia402 {
    pub use ecan_cia402::*;
}

/// Configurations: plain data that is checked as a whole before anything touches the bus.
pub mod config {
    #[cfg(feature = "cia402")]
    pub use ecan_canopen::{NetworkConfig, NodeConfig, SdoConfig, SyncConfig};
    #[cfg(feature = "cia402")]
    pub use ecan_cia402::{AxisConfig, Cia402Config};
    pub use ecan_host::{AdapterConfig, DcSync, RealTimeConfig, SlaveConfig};
    pub use ecan_mcan_port::{
        ChannelConfig, Config, GatewayConfig, PortConfig, ScheduleConfig, Traffic,
    };
    pub use ecan_protocol::config::*;
    pub use ecan_protocol::image::{BudgetPolicy, EncapsulationProfile, OptionFlags};

    #[cfg(feature = "config-file")]
    pub use crate::config_file::*;
}

/// Simulated gateways, CAN buses, nodes and faults.
#[cfg(feature = "sim")]
pub mod sim {
    pub use ecan_sim::*;
}

/// The names of a usual program: `use ecan_lite::prelude::*;`.
pub mod prelude {
    pub use core::time::Duration;

    #[cfg(feature = "cia402")]
    pub use ecan_canopen::{NodeAddress, NodeId};
    #[cfg(feature = "cia402")]
    pub use ecan_cia402::{AxisOwner, Cia402};
    pub use ecan_host::Ecrt;
    pub use ecan_mcan_port::{
        BusWatch, ChannelHandle, Cycle, GatewayHandle, OkOrTemporary, Port, ReceivedView,
        SendOptions, check_delivery,
    };
    pub use ecan_protocol::can::{CanFrame, CanId};

    #[cfg(feature = "cia402")]
    pub use crate::config::{AxisConfig, Cia402Config};
    pub use crate::config::{ChannelConfig, Config, GatewayConfig};
    pub use crate::{OpenEcrt, Result};
}

/// The programs in README.md compile.
#[cfg(doctest)]
#[doc = include_str!("../../README.md")]
struct Readme;
