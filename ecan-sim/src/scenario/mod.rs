//! Scenarios: the descriptions of simulations.

mod file;
mod model;

pub use file::ScenarioError;
pub use model::MasterBehaviour;
pub use model::{BUILTIN_SCENARIOS, ConfiguredDrive, drives, echo, jitter};
pub use model::{
    ClockKind, DriveSpec, EcrtVersion, GatewaySpec, NodeKind, NodeSpec, Scenario, Topology,
};
pub use model::{IoBehaviour, IoSpec};
pub(crate) use model::{MAX_GATEWAYS, by_name, configured};
