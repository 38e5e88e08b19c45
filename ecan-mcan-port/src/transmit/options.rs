//! Options, tickets and errors of sending.

use ecan_protocol::can::{CanFrame, FrameError};
use ecan_protocol::image::Schedule;
use thiserror::Error;

use crate::address::{AddressError, ChannelHandle};
use crate::schedule::margin::NotSchedulable;

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
    /// [`Backpressure::Phase`] if the cycle began too late for its phase, and withdrawn if the cycle
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

/// Reason for which a frame must wait.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Backpressure {
    /// The RxPDO image of this cycle is full: its bytes or its 255 packets.
    Image,
    /// The channel has used its share of the RxPDO image of this cycle, by the budget policy (0x8011:06, manual 12).
    Share,
    /// The channel's transmit queue in the gateway may be full, by its status.
    Queue,
    /// The channel is bus-off: the gateway would drop the frame.
    BusOff,
    /// Phase of a scheduled frame: this cycle began too late for it, or an unconfirmed image is sent
    /// before.
    Phase,
}

/// Error of a frame that was not sent.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum SendError {
    /// The frame must wait; temporary.
    #[error(
        "slave {slave} channel {channel}: no room for a frame: {}; retry in a later cycle",
        match what {
            Backpressure::Image => "the image of this cycle is full",
            Backpressure::Share => "its share of the image (0x8011:06) is used in this cycle",
            Backpressure::Queue => "the gateway's transmit queue is full",
            Backpressure::BusOff => "the channel is bus-off",
            Backpressure::Phase => "this cycle is too late for its Sync0 phase",
        }
    )]
    Backpressure {
        /// Slave index.
        slave: usize,
        /// Channel.
        channel: u8,
        /// Reason.
        what: Backpressure,
    },
    /// The gateway is not ready; temporary.
    #[error("slave {slave} is not ready (not in OP or not verified); retry in a later cycle")]
    NotReady {
        /// Slave index.
        slave: usize,
    },
    /// The channel does not exist or is not enabled.
    #[error(transparent)]
    Address(#[from] AddressError),
    /// A channel that only receives.
    #[error(
        "slave {slave} channel {channel} only receives: it is not in the channel mask of the RxPDO \
         (0x8011:04); add it to the mask in the gateway's configuration"
    )]
    ReceiveOnly {
        /// Slave index.
        slave: usize,
        /// Channel.
        channel: u8,
    },
    /// A CAN FD frame for a classic channel.
    #[error("slave {slave} channel {channel} is configured for classic CAN only")]
    NotFd {
        /// Slave index.
        slave: usize,
        /// Channel.
        channel: u8,
    },
    /// A packet that is larger than the channel's share of an RxPDO image (0x8011:06, manual 12).
    #[error(
        "slave {slave} channel {channel}: a packet of {bytes} bytes exceeds the channel's share of {share} bytes of \
         the RxPDO (0x8011:06); use a larger N or the budget policy `shared_only`"
    )]
    BeyondShare {
        /// Slave index.
        slave: usize,
        /// Channel.
        channel: u8,
        /// Bytes of the packet, padding included.
        bytes: usize,
        /// Most bytes of the channel in an image.
        share: usize,
    },
    /// A schedule that the configuration or the gateway does not support.
    #[error("slave {slave} cannot schedule a frame at {offset_ns} ns: {reason}")]
    NotSchedulable {
        /// Slave index.
        slave: usize,
        /// Phase of the frame, in nanoseconds.
        offset_ns: u32,
        /// Reason.
        reason: NotSchedulable,
    },
    /// The data are not a valid CAN frame.
    #[error(transparent)]
    Frame(#[from] FrameError),
}

impl SendError {
    /// Returns whether the cause passes by itself, so that the frame can be sent in a later cycle.
    pub fn is_temporary(&self) -> bool {
        matches!(self, Self::Backpressure { .. } | Self::NotReady { .. })
    }
}

/// Ignores temporary errors of sending.
pub trait OkOrTemporary<T> {
    /// Returns `Ok(None)` for a [temporary](SendError::is_temporary) error: the frame was not sent.
    ///
    /// # Errors
    /// Every other [`SendError`].
    fn ok_or_temporary(self) -> Result<Option<T>, SendError>;
}

impl<T> OkOrTemporary<T> for Result<T, SendError> {
    fn ok_or_temporary(self) -> Result<Option<T>, SendError> {
        match self {
            Ok(value) => Ok(Some(value)),
            Err(error) if error.is_temporary() => Ok(None),
            Err(error) => Err(error),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_a_temporary_error_is_left_out() {
        let not_fd = SendError::NotFd { slave: 0, channel: 1 };
        for (sent, expected) in [
            (Ok(7), Ok(Some(7))),
            (Err(SendError::NotReady { slave: 0 }), Ok(None)),
            (Err(not_fd), Err(not_fd)),
        ] {
            assert_eq!(sent.ok_or_temporary(), expected);
        }
    }
}
