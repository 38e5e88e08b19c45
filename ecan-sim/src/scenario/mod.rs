//! Scenarios: the descriptions of simulations.

mod builtin;
mod file;
mod model;

pub(crate) use builtin::by_name;
pub use builtin::{BUILTIN_SCENARIOS, drives, echo, jitter};
pub use file::ScenarioError;
pub use model::MasterBehaviour;
pub use model::{
    ClockKind, DriveSpec, EcrtVersion, GatewaySpec, NodeKind, NodeSpec, Scenario, Topology,
};
pub use model::{IoBehaviour, IoSpec};
