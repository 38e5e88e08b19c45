//! Access to the slaves outside the cycle: state, SDO transfers, identification, PDO mapping.

mod can_controller;
mod capability_values;
mod diagnostics;
pub(crate) mod identification;
mod maintenance;
pub(crate) mod mapping;
mod recognition;
mod slave_access;

pub use can_controller::{CanController, RegisterServiceError};
pub(crate) use capability_values::CapabilityValues;
pub use diagnostics::Diagnostics;
pub use maintenance::{Maintenance, MaintenanceError};
pub use recognition::{IdentificationError, SlaveKind, SlaveQuery, denies_object, slave_kinds};
pub use slave_access::SlaveAccess;
