//! Identification, AL states, capabilities and maintenance of a gateway (manual 13.8, 13.9).

mod al_status;
mod capabilities;
mod controller_mode;
mod maintenance;
mod missing_entries;

pub use al_status::{AlState, AlStatusCode};
pub use capabilities::{Capabilities, FeatureFlags, Recognition};
pub use controller_mode::{CCCR, CCCR_INIT, ControllerMode, TEST};
pub use maintenance::{AccessMode, MaintenanceCommand, MaintenanceStatus};
pub use missing_entries::{OptionalObject, assumed_value};
