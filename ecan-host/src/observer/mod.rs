//! Observation of the cycle, and commands to it, from other threads.

mod commands;
mod handle;
mod quick_stops;
mod ring;
mod snapshot;

pub(crate) use snapshot::CycleRecord;

pub use commands::{CommandTicket, NoSuchAxis};
pub use handle::Observer;
pub use quick_stops::{QuickStop, QuickStops};
pub use ring::{Section, SectionWriter, WordGroup, WordGroups};
pub use snapshot::{ObserverError, Publisher, Snapshot};
