//! Sending CAN frames in a cycle: at once or at a phase of the next Sync0 period.

use ecan_protocol::can::{CanFrame, FrameError, FrameRef};
use ecan_protocol::image::{PushError, Schedule};
use thiserror::Error;

use crate::address::{AddressError, ChannelHandle};
use crate::cycle::Cycle;
use crate::gateway::Gateway;
use crate::port::Port;
use crate::schedule_margin::NotSchedulable;
use crate::schedule_settings::MarginCheck;

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

/// Hint for the gateway's transmit path (ID_AUX, manual 8.1).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum TransmitHint {
    /// No preference.
    #[default]
    Normal,
    /// High priority.
    HighPriority,
    /// A dedicated TX buffer.
    DedicatedBuffer,
    /// The TX queue, sorted by CAN ID.
    Queue,
}

impl TransmitHint {
    fn id_aux(self) -> u8 {
        match self {
            Self::Normal => 0,
            Self::HighPriority => 1,
            Self::DedicatedBuffer => 2,
            Self::Queue => 3,
        }
    }
}

/// Options of a frame; the default sends at once.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct SendOptions {
    /// Hint for the gateway's transmit path.
    pub hint: TransmitHint,
    /// Phase of the next Sync0 period at which the gateway sends the frame, in nanoseconds, with a
    /// tag of the application (manual 8.4, 13.8). Needs distributed clocks.
    ///
    /// After a wait by [`next_cycle`](Port::next_cycle) a frame is rejected with
    /// [`Backpressure::Phase`] if the cycle began too late for its phase, and withdrawn if the cycle
    /// ends too late. On an attached Adapter neither happens, because Sync0 follows the owner's
    /// deadlines. A frame leaves a period late only if its image was lost and sent again because it
    /// also holds frames to be sent at once; it then counts as unknown.
    /// [`schedule_margin`](Port::schedule_margin) returns the time that a phase leaves,
    /// [`schedule_account`](Port::schedule_account) the results.
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
    /// A CAN FD frame for a classic channel.
    #[error("slave {slave} channel {channel} is configured for classic CAN only")]
    NotFd {
        /// Slave index.
        slave: usize,
        /// Channel.
        channel: u8,
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
    /// Whether the cause passes by itself, so that the frame can be sent in a later cycle.
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

/// Result of a batch.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Batch {
    /// Frames sent, from the front of the batch.
    pub sent: usize,
    /// Error of the next frame; `None` if all were sent.
    pub stopped: Option<SendError>,
}

impl Cycle<'_> {
    /// Sends a frame at once: a [`CanFrame`] by reference or a [`FrameRef`].
    ///
    /// Writes the packet directly into the PDO image. Real-time safe.
    ///
    /// # Errors
    /// A [`SendError`]; nothing was sent.
    #[inline]
    pub fn send<'f>(
        &mut self,
        to: ChannelHandle,
        frame: impl Into<FrameRef<'f>>,
    ) -> Result<SendTicket, SendError> {
        self.port.send_now(to, frame.into())
    }

    /// As [`send`](Self::send), with a hint or a schedule.
    ///
    /// # Errors
    /// A [`SendError`]; nothing was sent.
    #[inline]
    pub fn send_with<'f>(
        &mut self,
        to: ChannelHandle,
        frame: impl Into<FrameRef<'f>>,
        options: SendOptions,
    ) -> Result<SendTicket, SendError> {
        self.port.send_with(to, frame.into(), options)
    }

    /// Sends frames in order and stops at the first error, for all channels, so that the rest can be
    /// sent in order in a later cycle. Real-time safe.
    pub fn send_batch(&mut self, frames: &[TransmitFrame]) -> Batch {
        for (sent, frame) in frames.iter().enumerate() {
            if let Err(error) = self.send_with(frame.to, &frame.frame, frame.options) {
                return Batch { sent, stopped: Some(error) };
            }
        }
        Batch { sent: frames.len(), stopped: None }
    }
}

impl Port {
    fn send_now(
        &mut self,
        to: ChannelHandle,
        frame: FrameRef<'_>,
    ) -> Result<SendTicket, SendError> {
        self.put(to, frame, SendOptions::default(), true)
    }

    fn send_with(
        &mut self,
        to: ChannelHandle,
        frame: FrameRef<'_>,
        options: SendOptions,
    ) -> Result<SendTicket, SendError> {
        let has_margin = match options.schedule {
            Some(schedule) => {
                self.check_channel(to, frame)?;
                self.check_phase(to, schedule.offset_ns)?
            }
            None => true,
        };
        self.put(to, frame, options, has_margin)
    }

    /// Writes a frame into the image; the phase of a schedule was checked before. Inlined into both
    /// callers: the one that sends at once, by far the more frequent, has no options to check.
    #[inline(always)]
    fn put(
        &mut self,
        to: ChannelHandle,
        frame: FrameRef<'_>,
        options: SendOptions,
        has_margin: bool,
    ) -> Result<SendTicket, SendError> {
        let (slave, channel) = (to.slave(), to.channel());
        let Some(gateway) = self.gateways.get_mut(slave) else {
            return self.reject_channel(to, frame);
        };
        if !gateway.accepts(channel, frame) {
            return self.reject_channel(to, frame);
        }
        if gateway.is_paced && !gateway.transmitter.window(channel).accepts_frames() {
            return Err(gateway.reject_paced(to));
        }
        let image = self.adapter.rx_pdo_mut(slave);
        let id_aux = options.hint.id_aux();
        match gateway.transmitter.push(image, channel, id_aux, frame, options.schedule) {
            Ok((sequence, index)) => {
                if options.schedule.is_some() {
                    gateway.transmitter.accounts_mut().scheduled(channel, has_margin);
                }
                Ok(SendTicket { slave, sequence, index })
            }
            Err(error) => Err(gateway.reject_push(to, error)),
        }
    }

    /// Checks that the gateway is ready and the channel suits the frame.
    fn check_channel(&self, to: ChannelHandle, frame: FrameRef<'_>) -> Result<(), SendError> {
        let (slave, channel) = (to.slave(), to.channel());
        let gateway = match self.gateways.get(slave) {
            Some(gateway) if gateway.has_channel(channel) => gateway,
            _ => return Err(self.wrong_address(slave, channel).into()),
        };
        if frame.is_fd() && !gateway.is_fd(channel) {
            return Err(SendError::NotFd { slave, channel });
        }
        if !gateway.session.is_ready() {
            return Err(SendError::NotReady { slave });
        }
        Ok(())
    }

    /// Error of [`check_channel`](Self::check_channel) for a frame that was not accepted.
    #[cold]
    #[inline(never)]
    fn reject_channel(
        &self,
        to: ChannelHandle,
        frame: FrameRef<'_>,
    ) -> Result<SendTicket, SendError> {
        self.check_channel(to, frame)?;
        Err(self.wrong_address(to.slave(), to.channel()).into())
    }

    /// Checks that this cycle can meet a phase; returns whether its margin suffices.
    fn check_phase(&mut self, to: ChannelHandle, offset_ns: u32) -> Result<bool, SendError> {
        let (slave, channel) = (to.slave(), to.channel());
        let reject = |reason| SendError::NotSchedulable { slave, offset_ns, reason };
        let margin = self.schedule_margin(to.gateway(), offset_ns);
        let begun_ns = self.deadline_ns.map(|_| self.adapter.cycle_start().late_ns);
        let Some(gateway) = self.gateways.get_mut(slave) else {
            return Err(self.wrong_address(slave, channel).into());
        };
        let accounts = gateway.transmitter.accounts_mut();
        accounts.asked(channel);
        let margin = margin.map_err(reject)?;
        let has_margin = margin.is_sufficient();
        if !has_margin && gateway.schedule.margin_check == MarginCheck::Reject {
            let lacking_ns = margin.lacking_ns();
            return Err(reject(NotSchedulable::NoMargin { lacking_ns }));
        }
        // Frames sent while an image is unconfirmed leave in a later cycle.
        let is_late =
            begun_ns.is_some_and(|ns| gateway.schedule_times.misses_pulse(self.since_first_ns, ns));
        if is_late || gateway.transmitter.is_unconfirmed() {
            gateway.transmitter.accounts_mut().refused_late(channel);
            return Err(SendError::Backpressure { slave, channel, what: Backpressure::Phase });
        }
        Ok(has_margin)
    }
}

impl Gateway {
    /// Counts a frame that a paced channel rejects, and returns the reason.
    #[cold]
    #[inline(never)]
    fn reject_paced(&mut self, to: ChannelHandle) -> SendError {
        let (slave, channel) = (to.slave(), to.channel());
        let statistics = self.statistics.channel(channel);
        let what = if self.transmitter.window(channel).is_bus_off() {
            statistics.refused_bus_off += 1;
            Backpressure::BusOff
        } else {
            statistics.refused_queue_full += 1;
            Backpressure::Queue
        };
        SendError::Backpressure { slave, channel, what }
    }

    /// Counts a frame that does not fit the image, and returns the reason.
    #[cold]
    #[inline(never)]
    fn reject_push(&mut self, to: ChannelHandle, error: PushError) -> SendError {
        let (slave, channel) = (to.slave(), to.channel());
        match error {
            PushError::NoRoom { .. } | PushError::TooManyPackets | PushError::Buffer { .. } => {
                self.statistics.channel(channel).refused_image_full += 1;
                SendError::Backpressure { slave, channel, what: Backpressure::Image }
            }
            _ => AddressError::Disabled { slave, channel }.into(),
        }
    }
}
