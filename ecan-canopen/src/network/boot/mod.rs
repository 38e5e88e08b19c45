//! Boot-up of nodes (CiA 302-2).

mod config;
mod execution;
mod parameters;

pub use config::{BootConfig, BootError, BootPhase, BootReset, IdentityCheck, RevisionCheck};
pub(super) use execution::NetworkBoot;
pub use execution::{BootProgress, BootState};
pub use parameters::{ConfigurationDate, Parameter, ParameterError, ParameterSet, Subject};
pub(super) use parameters::{ParameterDownload, ParameterState};
