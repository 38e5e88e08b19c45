//! Scenarios: what a simulation is made of.

mod builtin;
mod fault_file;
mod file;
mod model;

pub(crate) use builtin::by_name;
pub use builtin::{BUILTIN_SCENARIOS, echo};
pub use file::ScenarioError;
pub use model::{
    ClockKind, EcrtVersion, FaultyBehaviour, GatewaySpec, NodeKind, NodeSpec, Scenario, Topology,
};
