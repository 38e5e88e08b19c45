//! Boot-up of nodes (CiA 302-2).

mod boot_config;
mod boot_error;
mod boot_phase;
mod identity;
mod network_boot;
mod node_boot;
mod parameter;
mod parameter_download;
mod parameter_error;

pub use boot_config::{BootConfig, BootReset};
pub use boot_error::BootError;
pub use boot_phase::BootPhase;
pub use identity::{IdentityCheck, RevisionCheck};
pub use network_boot::BootState;
pub use node_boot::BootProgress;
pub use parameter::{ConfigurationDate, Parameter, ParameterSet, Subject};
pub use parameter_error::ParameterError;

pub(super) use network_boot::NetworkBoot;
pub(super) use parameter_download::{ParameterDownload, ParameterState};
