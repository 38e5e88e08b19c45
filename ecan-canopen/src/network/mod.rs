//! A CANopen master over a Port (CiA 301).

// Cycle
mod address;
mod channel;
mod config;
mod emcy_log;
mod error;
mod frame_sink;
mod guarding;
mod guarding_config;
mod heartbeat;
mod lss;
#[expect(clippy::module_inception, reason = "a file has the name of its main type")]
mod network;
mod network_cycle;
mod network_lss;
mod network_parameters;
mod network_startup;
mod network_sync;
mod nmt_tracker;
mod node;
mod period_timer;
mod sdo;
mod sdo_error;
mod service_sender;
mod statistics;
mod sync_producer;
mod time_producer;

pub use address::{NodeAddress, NodeHandle};
pub use config::{
    BlockTransferConfig, HostHeartbeat, NetworkConfig, NodeConfig, SdoConfig, SyncConfig,
};
pub use emcy_log::{EMCY_DEPTH, EmcyLog, EmcyRecord};
pub use error::{NetworkError, NmtError, WaitError};
pub use guarding::GuardErrors;
pub use guarding_config::GuardingConfig;
pub use heartbeat::Heartbeat;
pub use lss::{
    Lss, LssCommand, LssConfig, LssFailure, LssFault, LssMaster, LssResult, LssStartError,
};
pub use network::Network;
pub use node::NodeStatus;
pub use sdo::{Sdo, SdoClient};
pub use sdo_error::{SdoFailure, SdoFault, SdoStartError};
pub use statistics::ServiceStatistics;
pub use time_producer::{TimeConfig, TimeReference};

// Configuration of nodes
mod boot;
mod configurator;
#[cfg(feature = "device-files")]
mod description;
mod error_history;
mod mpdo_config;
mod node_action;
mod node_sequence;
mod parameter_storage;
mod pdo_mapping;
mod sdo_turn;
mod step_failure;

pub use boot::{
    BootConfig, BootError, BootPhase, BootProgress, BootReset, BootState, ConfigurationDate,
    IdentityCheck, Parameter, ParameterError, ParameterSet, RevisionCheck, Subject,
};
pub use configurator::{Configurator, Progress};
#[cfg(feature = "device-files")]
pub use description::{
    ChannelDescription, DescriptionError, NetworkDescription, NetworkFault, NetworkFaultKind,
    NodeDescription, PdoName,
};
pub use error_history::ErrorHistory;
pub use mpdo_config::{MpdoConfig, MpdoConfigError, MpdoMode};
pub use node_action::{NodeAction, Step};
pub use node_sequence::{Configuring, NodeSequence};
pub use parameter_storage::{ParameterGroup, StorageCapability};
pub use pdo_mapping::{PdoDirection, PdoMapping, PdoMappingError};
pub use step_failure::{NodeAccessError, StepFailure, StepFault};

// Blocking calls
mod blocking;
mod wait;

pub use wait::{run_cycle_uninterrupted, run_cycle_until};

pub use ecan_host::SdoDirection;
pub use ecan_protocol::sequence::{Expectation, SdoValue, Tolerance};

#[cfg(test)]
mod configurator_tests;
#[cfg(test)]
mod network_services_tests;
#[cfg(test)]
mod network_tests;
