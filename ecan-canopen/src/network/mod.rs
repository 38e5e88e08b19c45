//! A CANopen master over a Port (CiA 301).
//!
//! `master` holds the network: nodes and channels are in `node_table`, one node with its life sign in `node`
//! and `life_sign`, the clients of services in `sdo` and `lss`. `service_sender` sends what is due. `boot` boots
//! nodes, `node_sequence` and `configurator` execute lists of steps, `blocking` runs the cycle itself.

mod blocking;
mod boot;
mod config;
mod configurator;
#[cfg(feature = "device-files")]
mod description;
mod error;
mod life_sign;
mod lss;
mod master;
mod node;
mod node_sequence;
mod node_table;
mod pdo_mapping;
mod producers;
mod sdo;
mod service_sender;
mod storage;

pub use blocking::{Blocking, Changes, run_cycle_uninterrupted, run_cycle_until};
pub use boot::{
    BootConfig, BootError, BootPhase, BootProgress, BootReset, BootState, ConfigurationDate,
    IdentityCheck, Parameter, ParameterError, ParameterSet, RevisionCheck, Subject,
};
pub use config::{
    BlockTransferConfig, GuardingConfig, HostHeartbeat, NetworkConfig, NodeAction, NodeAddress,
    NodeConfig, NodeHandle, SdoConfig, Step, SyncConfig,
};
pub use configurator::{Configurator, Progress};
#[cfg(feature = "device-files")]
pub use description::{
    ChannelDescription, DescriptionError, NetworkDescription, NetworkFault, NetworkFaultKind,
    NodeDescription, PdoName,
};
pub use ecan_host::SdoDirection;
pub use ecan_protocol::sequence::{Expectation, SdoValue, Tolerance};
pub use error::{
    NetworkError, NmtError, NodeAccessError, SdoFailure, SdoFault, SdoStartError, SdoStray,
    StepFailure, StepFault, WaitError,
};
pub use life_sign::{GuardErrors, Heartbeat};
pub use lss::{
    Lss, LssCommand, LssConfig, LssFailure, LssFault, LssMaster, LssResult, LssStartError,
};
pub use master::Network;
pub use node::{EMCY_DEPTH, EmcyLog, EmcyRecord, NodeStatus};
pub use node_sequence::{Configuring, NodeSequence};
pub use pdo_mapping::{
    MpdoConfig, MpdoConfigError, MpdoMode, PdoDirection, PdoMapping, PdoMappingError,
};
pub use producers::{TimeConfig, TimeReference};
pub use sdo::{Sdo, SdoClient};
pub use service_sender::ServiceStatistics;
pub use storage::{ErrorHistory, ParameterGroup, StorageCapability};

#[cfg(test)]
mod configurator_tests;
#[cfg(test)]
mod network_tests;
