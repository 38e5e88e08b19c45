//! Events of the bus and faults to inject.

use ecan_protocol::can::CanFrame;

use super::station::{ErrorState, StationId};

/// One event on the bus. Times in simulated nanoseconds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BusEvent {
    /// A station's frame was sent and acknowledged (or looped back).
    Transmitted {
        /// The sender.
        station: StationId,
        /// The frame as sent on the wire: ESI is set if the sender was error passive, and an FD
        /// frame of a classic station was sent in classic format.
        frame: CanFrame,
        /// Start of frame.
        start_ns: u64,
        /// End of frame.
        at_ns: u64,
    },
    /// A station received a frame.
    Received {
        /// The receiver.
        station: StationId,
        /// The frame.
        frame: CanFrame,
        /// Start of frame.
        start_ns: u64,
        /// End of frame.
        at_ns: u64,
    },
    /// A transmission ended in an error frame or was not acknowledged.
    ErrorFrame {
        /// The sender.
        transmitter: StationId,
        /// End of the error delimiter.
        at_ns: u64,
    },
    /// A station without automatic retransmission discarded a frame after an error or lost
    /// arbitration.
    Abandoned {
        /// The station.
        station: StationId,
        /// The frame.
        frame: CanFrame,
        /// Time.
        at_ns: u64,
    },
    /// The error state of a station changed.
    StateChanged {
        /// The station.
        station: StationId,
        /// The new state.
        state: ErrorState,
        /// Time.
        at_ns: u64,
    },
}

/// A fault to inject.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BusFault {
    /// A bit error disturbs the next `count` transmissions of a station.
    ErrorFrames {
        /// The station.
        station: StationId,
        /// Number of transmissions.
        count: u32,
    },
    /// A station becomes bus-off at once; a frame in transmission ends in an error frame.
    BusOff(StationId),
}

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
