//! Access to the slaves outside the cycle: state, SDO transfers, identification, PDO mapping.

mod diagnostics;
mod maintenance;
pub(crate) mod mapping;
pub(crate) mod recognition;

pub(crate) use recognition::CapabilityValues;

pub use diagnostics::{Diagnostics, SlaveAccess, run_in_parallel, spawn_scoped};
pub use maintenance::{CanController, Maintenance, MaintenanceError, RegisterServiceError};
pub use recognition::{IdentificationError, SlaveKind, SlaveQuery, denies_object, slave_kinds};
