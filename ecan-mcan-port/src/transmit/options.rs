//! Options of a sent frame, and the ticket that identifies it.

use ecan_protocol::can::CanFrame;
use ecan_protocol::image::Schedule;

use crate::address::ChannelHandle;

/// Identifies a sent frame; its transmit result carries the same ticket (manual 10).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct SendTicket {
    /// Slave index.
    pub slave: usize,
    /// Sequence of the image.
    pub sequence: u16,
    /// Index of the frame in the image, from 0, when it was sent. Withdrawing a scheduled frame
    /// before it does not change the ticket.
    pub index: u8,
}

/// Hint for the gateway's transmit path, with the values of ID_AUX (manual 8.1).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum TransmitHint {
    /// No preference.
    #[default]
    Normal = 0,
    /// High priority.
    HighPriority = 1,
    /// A dedicated TX buffer.
    DedicatedBuffer = 2,
    /// The TX queue, sorted by CAN ID.
    Queue = 3,
}

/// Options of a frame; the default sends at once.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct SendOptions {
    /// Hint for the gateway's transmit path.
    pub hint: TransmitHint,
    /// Phase of the next Sync0 period at which the gateway sends the frame, in nanoseconds, with a
    /// tag of the application (manual 8.4, 13.8). Needs distributed clocks.
    ///
    /// After a wait by [`next_cycle`](crate::Port::next_cycle) a frame is rejected with
    /// [`Backpressure::Phase`](crate::Backpressure::Phase) if the cycle began too late for its phase, and withdrawn if the cycle
    /// ends too late. On an attached Adapter neither happens, because Sync0 follows the owner's
    /// deadlines. A frame leaves a period late only if its image was lost and sent again because it
    /// also holds frames to be sent at once; it then counts as unknown.
    /// [`schedule_margin`](crate::Port::schedule_margin) returns the time that a phase leaves,
    /// [`schedule_account`](crate::Port::schedule_account) the results.
    pub schedule: Option<Schedule>,
}

impl From<Schedule> for SendOptions {
    /// Sends at a phase of the next Sync0 period, without a hint.
    fn from(schedule: Schedule) -> Self {
        Self { schedule: Some(schedule), ..Self::default() }
    }
}

/// A frame with its destination, for batches.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TransmitFrame {
    /// Channel that sends it.
    pub to: ChannelHandle,
    /// The frame.
    pub frame: CanFrame,
    /// Options of the frame.
    pub options: SendOptions,
}

impl TransmitFrame {
    /// A frame that is sent at once.
    pub fn new(to: ChannelHandle, frame: CanFrame) -> Self {
        Self { to, frame, options: SendOptions::default() }
    }
}
