//! Configuration of an [`Adapter`](crate::Adapter), and its check.

mod adapter_config;
mod config_fault;
mod dc_sync;
mod faults;

pub(crate) use adapter_config::WATCHDOG_UNIT;
pub use adapter_config::{
    AdapterConfig, Identity, MAX_SLAVES, MAX_STARTUP_STEPS, SlaveConfig, StartupEntry,
};
pub use config_fault::ConfigFault;
pub use dc_sync::{ClockSource, DcSync};
pub use faults::Faults;
