use ecan_protocol::can::CanFrame;

use super::station::StationId;

/// A frame that every other station on the bus received, without effect on an error counter. Times in
/// simulated nanoseconds.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Broadcast {
    pub(crate) sender: StationId,
    pub(crate) frame: CanFrame,
    /// Start of frame.
    pub(crate) start_ns: u64,
    /// End of frame.
    pub(crate) at_ns: u64,
}
