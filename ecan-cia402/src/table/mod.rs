//! All axes of a bus: network, axis table and Port together.

mod axis_owner;
mod blocking;
mod check;
mod cia402;
mod commands;
mod cycle;
mod error;
mod load;
mod lookup;
mod node_services;
mod path_stop;
mod process_data;
mod sdo;
mod shared_node;
mod shutdown;
mod stop_together;
mod table_config;

pub use axis_owner::AxisOwner;
pub use check::{axis_conflicts, axis_faults};
pub use cia402::Cia402;
pub use cycle::SendSummary;
pub use error::{AxisFaults, AxisTimeout, BootTimeout, Cia402Error, ScheduleError};
pub use load::{BusLoad, LoadWarning, axis_traffic};
pub use path_stop::PathStop;
pub use shutdown::Shutdown;
pub use table_config::Cia402Config;
