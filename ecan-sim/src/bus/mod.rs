//! A CAN bus with its stations: exact frame times, arbitration, error confinement.
//!
//! Time is in simulated nanoseconds and advances only when the caller demands it. Each station puts
//! one frame into arbitration, as a controller does; queues belong to the caller.

mod can_bus;
mod station;
mod timing;
mod wire_frame;

pub(crate) use can_bus::Broadcast;
pub use can_bus::CanBus;
pub use can_bus::{BusEvent, BusFault};
pub(crate) use station::StationSet;
pub use station::{BusError, DetectedError, ErrorState};
pub use station::{BusStatistics, StationStatistics};
pub use station::{StationConfig, StationId, StationMode};
pub use timing::{DelayCompensation, PhysicalLayer};
pub use timing::{FrameTiming, INTERMISSION_BITS, bits_ns};
pub use wire_frame::WireFrame;
pub use wire_frame::arbitration_key;
