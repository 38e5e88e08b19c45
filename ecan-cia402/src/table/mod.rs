//! All axes of a bus: network, axis table and Port together.

mod blocking;
mod cia402;
mod cycle;
mod handles;
mod load;
mod path_stop;
mod shared_node;
mod shutdown;
mod table_config;

pub use blocking::{AxisOwner, Blocking};
pub use cia402::Cia402;
pub use cycle::SendSummary;
pub use handles::{AxisHandle, AxisRef, Target};
pub use load::{BusLoad, LoadWarning, axis_traffic};
pub use path_stop::PathStop;
pub use shutdown::Shutdown;
pub use table_config::{
    AxisFaults, AxisTimeout, BootTimeout, Cia402Config, Cia402Error, ScheduleError, axis_conflicts,
    axis_faults,
};
