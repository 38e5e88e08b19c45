//! Tests of the simulated libethercat.

mod c_functions;
mod c_master;
mod clocks;
mod fault_descriptions;
mod faults;
mod idle_bus;
mod io_slave;
mod library_errors;
mod maintenance;
mod operation;
mod recovery_property;
mod requests;
mod scenario_file;
mod wake_up;
