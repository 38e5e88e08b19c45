//! Identification, AL states, capabilities and maintenance of a gateway (manual 13.8, 13.9).

mod al_status;

pub use crate::object::capabilities::{
    Capabilities, FeatureFlags, OptionalObject, Recognition, assumed_value,
};
pub use crate::object::maintenance::{AccessMode, MaintenanceCommand, MaintenanceStatus};
pub use crate::object::register_service::{CCCR, CCCR_INIT, ControllerMode, TEST};
pub use al_status::{AlState, AlStatusCode};
