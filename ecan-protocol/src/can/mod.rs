//! CAN and CAN FD frames: CAN IDs, lengths, bits on the bus, bit timing.

mod bit_timing;
mod can_id;
pub(crate) mod control;
mod dlc;
mod embedded;
mod frame;
mod frame_bits;
mod frame_error;
mod sample_point_choice;
mod vendor_driver;

pub use bit_timing::{
    BITRATE_TOLERANCE_PPM, BitTiming, BitTimingError, MCAN_CLOCK_HZ, Phase, SamplePoint,
    TDC_FORCED_FROM, TDC_MAX_PRESCALER, TimingLimits, solve_bit_timing, tdc_active,
};
pub use can_id::CanId;
pub use dlc::Dlc;
pub use embedded::IdFormatError;
pub use frame::{CanFrame, FrameKind, FrameRef};
pub use frame_bits::FrameBits;
pub use frame_error::FrameError;
pub use sample_point_choice::{sample_point_range, usual_sample_point};
pub use vendor_driver::vendor_driver_timing;
