//! Observation of the cycle, and commands to it, from other threads.

mod commands;
#[cfg(all(test, loom))]
mod interleaving_tests;
mod quick_stops;
mod ring;
mod snapshot;

pub use commands::{CommandTicket, NoSuchAxis, Observer};
pub use quick_stops::{QuickStop, QuickStops};
pub use ring::{Section, SectionWriter, WordGroup, WordGroups};
pub(crate) use snapshot::CycleRecord;
pub use snapshot::{ObserverError, Publisher, Snapshot};
