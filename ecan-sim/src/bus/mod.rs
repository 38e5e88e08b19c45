//! A CAN bus with its stations: exact frame times, arbitration, error confinement.
//!
//! Time is in simulated nanoseconds and advances only when the caller demands it. Each station puts
//! one frame into arbitration, as a controller does; queues belong to the caller.

mod arbitration;
mod broadcast;
mod can_bus;
mod crc;
mod error_confinement;
mod event;
mod frame_timing;
mod header_bits;
mod physical_layer;
mod recovery;
mod station;
mod station_set;
mod statistics;
mod stuffing;
mod wire_frame;

pub use arbitration::arbitration_key;
pub(crate) use broadcast::Broadcast;
pub use can_bus::CanBus;
pub use error_confinement::{BusError, DetectedError, ErrorState};
pub use event::{BusEvent, BusFault};
pub use frame_timing::{FrameTiming, INTERMISSION_BITS, bits_ns};
pub use physical_layer::{DelayCompensation, PhysicalLayer};
pub use station::{StationConfig, StationId, StationMode};
pub(crate) use station_set::StationSet;
pub use statistics::{BusStatistics, StationStatistics};
pub use wire_frame::WireFrame;
