//! CAN and CAN FD frames: CAN IDs, lengths, bits on the bus, bit timing.

mod bit_timing;
mod can_id;
pub(crate) mod control;
mod embedded;
mod frame;

pub use bit_timing::{
    BITRATE_TOLERANCE_PPM, BitTiming, BitTimingError, MCAN_CLOCK_HZ, Phase, SamplePoint,
    TDC_FORCED_FROM, TDC_MAX_PRESCALER, TimingLimits, sample_point_range, solve_bit_timing,
    tdc_active, usual_sample_point, vendor_driver_timing,
};
pub use can_id::{CanId, FrameError};
pub use control::Dlc;
pub use embedded::IdFormatError;
pub use frame::{CanFrame, FrameBits, FrameKind, FrameRef};
