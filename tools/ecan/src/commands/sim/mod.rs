//! `ecan sim`: the simulated machine of a running service.

mod command;
mod fault;
mod status;

pub use command::{EXAMPLES, FAULT_METHOD, FAULTS_METHOD, STATUS_METHOD, SimArguments, run};
pub use fault::{FaultList, FaultReport};
pub use status::SimulationStatus;
