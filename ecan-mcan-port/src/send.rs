//! Sending CAN frames: immediately or at a phase of the next Sync0 period.

use ecan_protocol::can::{CanFrame, CanId, FrameError, FrameRef};
use ecan_protocol::image::{PushError, Schedule};
use ecan_protocol::mapping::CHANNELS;
use thiserror::Error;

use crate::port::{Gateway, Port};
use crate::schedule_settings::MarginCheck;

/// Where a frame went: the image and its place among the frames of the image. A transmit result
/// names the same (manual 10).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct SendTicket {
    /// Slave index.
    pub slave: usize,
    /// Sequence of the image.
    pub sequence: u16,
    /// Place of the frame in the image, from 0, as long as no scheduled frame before it is taken
    /// back.
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
    /// The TX queue, sorted by identifier.
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

/// How a frame is sent; the default sends at once.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct SendOptions {
    /// Hint for the gateway's transmit path.
    pub hint: TransmitHint,
    /// Phase of the next Sync0 period at which the gateway hands the frame to the bus, in
    /// nanoseconds, with a tag of the application (manual 8.4). Needs distributed clocks.
    pub schedule: Option<Schedule>,
}

/// A frame with its destination, for batches.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TransmitFrame {
    /// Slave index.
    pub slave: usize,
    /// Channel of the gateway, 0..3.
    pub channel: u8,
    /// The frame.
    pub frame: CanFrame,
    /// How it is sent.
    pub options: SendOptions,
}

impl TransmitFrame {
    /// A frame that is sent at once.
    pub fn new(slave: usize, channel: u8, frame: CanFrame) -> Self {
        Self { slave, channel, frame, options: SendOptions::default() }
    }
}

/// What is full.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Backpressure {
    /// The RxPDO image of this cycle: bytes or the 255 packets of an image.
    Image,
    /// The channel's transmit queue in the gateway, as far as its status tells.
    Queue,
    /// The channel is off the bus: the gateway would throw the frame away.
    BusOff,
    /// The phase of a scheduled frame: this cycle began too late for it, or an image that may not
    /// have arrived goes out before.
    Phase,
}

/// Why a frame was not taken. Nothing of it was sent.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum SendError {
    /// No room; send it again in a later cycle.
    #[error(
        "no room for a frame to slave {slave} channel {channel}: {}",
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
        /// What is full.
        what: Backpressure,
    },
    /// The gateway is not in service: not in OP, or not verified yet.
    #[error("slave {slave} is not in service")]
    NotReady {
        /// Slave index.
        slave: usize,
    },
    /// No such slave.
    #[error("slave index {slave} is out of range")]
    SlaveIndex {
        /// The index given.
        slave: usize,
    },
    /// The channel does not exist or is not enabled.
    #[error("channel {channel} of slave {slave} is not enabled")]
    Channel {
        /// Slave index.
        slave: usize,
        /// The channel given.
        channel: u8,
    },
    /// A CAN FD frame for a classic channel.
    #[error("channel {channel} of slave {slave} is configured for classic CAN only")]
    NotFd {
        /// Slave index.
        slave: usize,
        /// Channel.
        channel: u8,
    },
    /// A schedule that the configuration or the gateway cannot serve.
    #[error("slave {slave} cannot schedule a frame at {offset_ns} ns: {reason}")]
    NotSchedulable {
        /// Slave index.
        slave: usize,
        /// The phase asked for, in nanoseconds.
        offset_ns: u32,
        /// Why not.
        reason: NotSchedulable,
    },
    /// The frame itself is not a CAN frame.
    #[error(transparent)]
    Frame(#[from] FrameError),
    /// Between `cycle_end` and the next `cycle_begin` there is no image to put frames into.
    #[error("no cycle is open: call cycle_begin first")]
    NoCycle,
}

/// Why a frame cannot be scheduled.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum NotSchedulable {
    /// Distributed clocks are not configured.
    #[error(
        "distributed clocks with Sync0 are not configured: configure them, or send frames at once"
    )]
    NoSync0,
    /// The gateway does not have the capability.
    #[error("the gateway has no scheduled transmission (0xF000:16 bit 8)")]
    NotSupported,
    /// The offset lies beyond the Sync0 period.
    #[error(
        "the offset is not below the Sync0 period of {:.1} us: use a smaller one",
        f64::from(*sync0_ns) / 1e3
    )]
    BeyondPeriod {
        /// The Sync0 period, in nanoseconds.
        sync0_ns: u32,
    },
    /// The phase is not surely reached in time, and
    /// [`MarginCheck::Refuse`](crate::MarginCheck::Refuse) is chosen.
    #[error(
        "the margin is short by {:.1} us: move the Sync0 shift away from the arrival of the images, \
         or enlarge the offset", *lacking_ns as f64 / 1e3
    )]
    NoMargin {
        /// What the margin lacks, in nanoseconds.
        lacking_ns: u64,
    },
}

impl Port {
    /// Sends a classic CAN data frame with up to 8 bytes.
    ///
    /// Like all functions here real-time safe, between `cycle_begin` and `cycle_end`: the packet
    /// is written once, into the process image.
    ///
    /// # Errors
    /// A [`SendError`]; nothing was sent.
    pub fn send_can(
        &mut self,
        slave: usize,
        channel: u8,
        id: CanId,
        data: &[u8],
    ) -> Result<SendTicket, SendError> {
        self.send(slave, channel, FrameRef::classic(id, data)?)
    }

    /// Sends a CAN FD frame; its length must be one that a DLC can express (manual 8.2).
    ///
    /// # Errors
    /// A [`SendError`]; nothing was sent.
    pub fn send_canfd(
        &mut self,
        slave: usize,
        channel: u8,
        id: CanId,
        data: &[u8],
        bit_rate_switch: bool,
    ) -> Result<SendTicket, SendError> {
        self.send(slave, channel, FrameRef::fd(id, data, bit_rate_switch, false)?)
    }

    /// Sends a classic frame at a phase of the next Sync0 period (manual 8.4, 13.8).
    ///
    /// A frame whose phase cannot be reached any more is not taken ([`Backpressure::Phase`]), as far as
    /// the cycle is waited for with [`wait_next_cycle`](Self::wait_next_cycle), and one that is taken
    /// is taken back where [`cycle_end`](Self::cycle_end) comes too late. On an attached Adapter
    /// neither happens: Sync0 follows the owner's grid. A period late leaves otherwise only a frame
    /// whose image was lost and published again, since it holds frames to be sent at once, too; it
    /// counts as unknown. [`schedule_margin`](Self::schedule_margin) tells how much time a
    /// phase leaves, [`schedule_account`](Self::schedule_account) what became of the frames.
    ///
    /// # Errors
    /// A [`SendError`]; nothing was sent.
    pub fn schedule_can(
        &mut self,
        slave: usize,
        channel: u8,
        id: CanId,
        data: &[u8],
        schedule: Schedule,
    ) -> Result<SendTicket, SendError> {
        self.send_with(slave, channel, FrameRef::classic(id, data)?, at(schedule))
    }

    /// Sends a CAN FD frame at a phase of the next Sync0 period.
    ///
    /// # Errors
    /// A [`SendError`]; nothing was sent.
    pub fn schedule_canfd(
        &mut self,
        slave: usize,
        channel: u8,
        id: CanId,
        data: &[u8],
        bit_rate_switch: bool,
        schedule: Schedule,
    ) -> Result<SendTicket, SendError> {
        let frame = FrameRef::fd(id, data, bit_rate_switch, false)?;
        self.send_with(slave, channel, frame, at(schedule))
    }

    /// Sends any frame at once.
    ///
    /// # Errors
    /// A [`SendError`]; nothing was sent.
    pub fn send(
        &mut self,
        slave: usize,
        channel: u8,
        frame: FrameRef<'_>,
    ) -> Result<SendTicket, SendError> {
        self.put(slave, channel, frame, SendOptions::default(), true)
    }

    /// Sends any frame with a hint or a schedule.
    ///
    /// # Errors
    /// A [`SendError`]; nothing was sent.
    pub fn send_with(
        &mut self,
        slave: usize,
        channel: u8,
        frame: FrameRef<'_>,
        options: SendOptions,
    ) -> Result<SendTicket, SendError> {
        let has_margin = match options.schedule {
            Some(schedule) => {
                self.check_place(slave, channel, frame)?;
                self.check_phase(slave, channel, schedule.offset_ns)?
            }
            None => true,
        };
        self.put(slave, channel, frame, options, has_margin)
    }

    /// Puts a frame into the image, unless something speaks against it; a schedule's phase was
    /// checked before. Inlined into its two callers, of which the one that sends at once, by far the
    /// more frequent, has no options to look at.
    #[inline(always)]
    fn put(
        &mut self,
        slave: usize,
        channel: u8,
        frame: FrameRef<'_>,
        options: SendOptions,
        has_margin: bool,
    ) -> Result<SendTicket, SendError> {
        let Some(gateway) = self.gateways.get_mut(slave).filter(|_| self.cycle_open) else {
            return self.refuse_place(slave, channel, frame);
        };
        if !gateway.takes(channel, frame) {
            return self.refuse_place(slave, channel, frame);
        }
        if gateway.is_paced && !gateway.transmitter.window(channel).takes_frames() {
            return Err(gateway.refuse_paced(slave, channel));
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
            Err(error) => Err(gateway.refuse_push(slave, channel, error)),
        }
    }

    /// Whether there is a gateway in service that takes such a frame on such a channel.
    fn check_place(&self, slave: usize, channel: u8, frame: FrameRef<'_>) -> Result<(), SendError> {
        if !self.cycle_open {
            return Err(SendError::NoCycle);
        }
        let gateway = self.gateways.get(slave).ok_or(SendError::SlaveIndex { slave })?;
        let enabled = usize::from(channel) < CHANNELS && gateway.channel_mask >> channel & 1 == 1;
        if !enabled {
            return Err(SendError::Channel { slave, channel });
        }
        if frame.is_fd() && gateway.fd_mask >> channel & 1 == 0 {
            return Err(SendError::NotFd { slave, channel });
        }
        if !gateway.session.is_ready() {
            return Err(SendError::NotReady { slave });
        }
        Ok(())
    }

    /// What [`check_place`](Self::check_place) finds, where something was found amiss.
    #[cold]
    #[inline(never)]
    fn refuse_place(
        &self,
        slave: usize,
        channel: u8,
        frame: FrameRef<'_>,
    ) -> Result<SendTicket, SendError> {
        self.check_place(slave, channel, frame)?;
        Err(SendError::Channel { slave, channel })
    }

    /// Whether a phase can be kept: gives whether its margin suffices.
    fn check_phase(
        &mut self,
        slave: usize,
        channel: u8,
        offset_ns: u32,
    ) -> Result<bool, SendError> {
        let refuse = |reason| SendError::NotSchedulable { slave, offset_ns, reason };
        if let Some(gateway) = self.gateways.get_mut(slave) {
            gateway.transmitter.accounts_mut().asked(channel);
        }
        let margin = self.schedule_margin(slave, offset_ns).map_err(refuse)?;
        let has_margin = margin.is_sufficient();
        let begun_ns = self.cycle_point_ns.map(|_| self.adapter.cycle_start().late_ns);
        let gateway = self.gateways.get_mut(slave).ok_or(SendError::SlaveIndex { slave })?;
        if !has_margin && gateway.schedule.margin_check == MarginCheck::Refuse {
            let lacking_ns = margin.lacking_ns();
            return Err(refuse(NotSchedulable::NoMargin { lacking_ns }));
        }
        // What is sent while an image is held goes out in a later cycle.
        let is_late =
            begun_ns.is_some_and(|ns| gateway.schedule_times.misses_pulse(self.since_first_ns, ns));
        if is_late || gateway.transmitter.is_holding() {
            gateway.transmitter.accounts_mut().refused_late(channel);
            return Err(SendError::Backpressure { slave, channel, what: Backpressure::Phase });
        }
        Ok(has_margin)
    }

    /// Bytes left in the RxPDO image that is being filled; a packet needs 4 to 78 of them (manual
    /// 8.3). Real-time safe; 0 for an index out of range.
    pub fn image_room(&self, slave: usize) -> usize {
        self.gateways.get(slave).map_or(0, |gateway| gateway.transmitter.room())
    }

    /// Gives up every frame that is not known to have reached the gateway, and returns their
    /// number. Frames of a held image may have been executed all the same. Real-time safe.
    pub fn discard_pending(&mut self, slave: usize) -> usize {
        self.gateways
            .get_mut(slave)
            .map_or(0, |gateway| gateway.transmitter.discard(&mut gateway.statistics))
    }
}

impl Gateway {
    /// Whether it is in service and the frame suits an enabled channel.
    #[inline(always)]
    fn takes(&self, channel: u8, frame: FrameRef<'_>) -> bool {
        let mask = if frame.is_fd() { self.channel_mask & self.fd_mask } else { self.channel_mask };
        usize::from(channel) < CHANNELS && mask >> channel & 1 == 1 && self.session.is_ready()
    }

    /// Why a paced channel takes no frame, counted.
    #[cold]
    #[inline(never)]
    fn refuse_paced(&mut self, slave: usize, channel: u8) -> SendError {
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

    /// Why the image takes no frame, counted.
    #[cold]
    #[inline(never)]
    fn refuse_push(&mut self, slave: usize, channel: u8, error: PushError) -> SendError {
        match error {
            PushError::NoRoom { .. } | PushError::TooManyPackets | PushError::Buffer { .. } => {
                self.statistics.channel(channel).refused_image_full += 1;
                SendError::Backpressure { slave, channel, what: Backpressure::Image }
            }
            _ => SendError::Channel { slave, channel },
        }
    }
}

fn at(schedule: Schedule) -> SendOptions {
    SendOptions { hint: TransmitHint::Normal, schedule: Some(schedule) }
}
