//! Observation of the cycle, and commands to it, from other threads.

mod commands;
mod handle;
mod publisher;
mod quick_stops;
mod ring;
mod section;
mod snapshot;
mod ticket;

pub use commands::NoSuchAxis;
pub use handle::Observer;
pub use quick_stops::{QuickStop, QuickStops};
pub use section::{Section, SectionWriter, WordGroup, WordGroups};
pub use snapshot::{ObserverError, Snapshot};
pub use ticket::CommandTicket;

pub(crate) use publisher::Publisher;
pub(crate) use snapshot::CycleRecord;
