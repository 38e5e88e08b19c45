//! Scenarios: the descriptions of simulations.

mod file;
mod model;

pub use file::ScenarioError;
pub use model::MasterBehaviour;
pub(crate) use model::by_name;
pub use model::{BUILTIN_SCENARIOS, drives, echo, jitter};
pub use model::{
    ClockKind, DriveSpec, EcrtVersion, GatewaySpec, NodeKind, NodeSpec, Scenario, Topology,
};
pub use model::{IoBehaviour, IoSpec};
