//! What the bus reports, and what a test can do to it.

use ecan_protocol::can::CanFrame;

use super::error_confinement::ErrorState;
use super::station::StationId;

/// One thing that happened on the bus. Times are nanoseconds of the simulation.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BusEvent {
    /// A station's frame went out and was acknowledged (or looped back).
    Transmitted {
        /// The sender.
        station: StationId,
        /// The frame as it was on the wire: the ESI bit is set when the sender was error
        /// passive, and an FD frame of a classic station went out in the classic format.
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
    /// A transmission was destroyed by an error frame or not acknowledged.
    ErrorFrame {
        /// Whose transmission it was.
        transmitter: StationId,
        /// End of the error delimiter.
        at_ns: u64,
    },
    /// A station without automatic retransmission gave a frame up: it failed, or lost
    /// arbitration.
    Abandoned {
        /// The station.
        station: StationId,
        /// The frame that will not be sent.
        frame: CanFrame,
        /// When.
        at_ns: u64,
    },
    /// A station's error state changed.
    StateChanged {
        /// The station.
        station: StationId,
        /// Its new state.
        state: ErrorState,
        /// When.
        at_ns: u64,
    },
}

/// A fault to inject.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BusFault {
    /// The next `count` transmissions of a station are hit by a bit error.
    ErrorFrames {
        /// Whose transmissions.
        station: StationId,
        /// How many.
        count: u32,
    },
    /// A station goes bus-off at once; a frame it is sending breaks off.
    BusOff(StationId),
}
