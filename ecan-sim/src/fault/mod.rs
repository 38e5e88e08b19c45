//! Faults: their table, their textual form, their schedule and the log of those that took effect.

mod description;
mod schedule;
mod table;

pub use description::{
    DrawnValue, FaultDescription, FaultDraw, FaultError, FaultKey, FaultKind, FaultValue,
};
pub(crate) use schedule::{CycleFaults, FaultSchedule};
pub use schedule::{FaultEffect, FaultRecord, ScriptedFault, When};
pub use table::{DriveFault, Fault, GatewayFault, LibraryCall, LossDirection};
