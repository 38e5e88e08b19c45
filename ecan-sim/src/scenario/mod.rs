//! Scenarios: what a simulation is made of.

mod builtin;
mod file;
mod model;

pub(crate) use builtin::by_name;
pub use builtin::{BUILTIN_SCENARIOS, drives, echo, jitter};
pub use file::ScenarioError;
pub use model::{
    ClockKind, DriveSpec, EcrtVersion, FaultyBehaviour, GatewaySpec, NodeKind, NodeSpec, Scenario,
    Topology,
};
