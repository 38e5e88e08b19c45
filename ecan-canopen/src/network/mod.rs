//! A CANopen master over a Port (CiA 301).

// Cycle
mod address;
mod channel;
mod emcy_log;
mod error;
mod frame_sink;
mod heartbeat;
mod network;
mod network_cycle;
mod network_sync;
mod nmt_tracker;
mod node;
mod sdo;
mod service_sender;
mod settings;
mod statistics;
mod sync_producer;

pub use address::{NodeAddress, NodeHandle};
pub use emcy_log::{EMCY_DEPTH, EmcyLog, EmcyRecord};
pub use error::{NetworkError, NmtError, SdoFailure, SdoFault, SdoStartError, WaitError};
pub use heartbeat::Heartbeat;
pub use network::Network;
pub use node::NodeStatus;
pub use sdo::{Sdo, SdoClient};
pub use settings::{
    BlockTransferConfig, HostHeartbeat, NetworkConfig, NodeConfig, SdoConfig, SyncConfig,
};
pub use statistics::ServiceStatistics;

// Configuration of nodes
mod configurator;
mod pdo_mapping;
mod step;
mod step_failure;
mod step_runner;

pub use configurator::{Configurator, Configuring, Progress};
pub use pdo_mapping::{PdoDirection, PdoMapping, PdoMappingError};
pub use step::{Action, SdoValue, Step, Tolerance};
pub use step_failure::{StepFailure, StepFault};

// Blocking calls
mod blocking;
mod wait;

pub use wait::{run_cycle_uninterrupted, run_cycle_until};

pub use ecan_host::SdoDirection;

#[cfg(test)]
mod configurator_tests;
#[cfg(test)]
mod network_tests;
