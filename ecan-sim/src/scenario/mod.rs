//! Scenarios: the descriptions of simulations.

mod builtin;
mod file;
mod io_spec;
mod master_behaviour;
mod model;

pub(crate) use builtin::by_name;
pub use builtin::{BUILTIN_SCENARIOS, drives, echo, jitter};
pub use file::ScenarioError;
pub use io_spec::{IoBehaviour, IoSpec};
pub use master_behaviour::MasterBehaviour;
pub use model::{
    ClockKind, DriveSpec, EcrtVersion, GatewaySpec, NodeKind, NodeSpec, Scenario, Topology,
};
