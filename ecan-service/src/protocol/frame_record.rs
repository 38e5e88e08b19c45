//! Records of CAN frames, from the service.

use ecan_protocol::can::CanFrame;
use ecan_protocol::image::ResultCode;
use ecan_protocol::mapping::CHANNELS;

use crate::protocol::wire_frame::{RecordError, fields_of, push_data, read_frame};

/// Bytes of a record without its data.
pub const FRAME_RECORD_BYTES: usize = 24;
/// Bytes of the longest record.
pub const MAX_FRAME_RECORD_BYTES: usize = FRAME_RECORD_BYTES + 64;

ecan_protocol::text_enum! {
    /// Reason for which the service rejected a frame of a client.
    #[non_exhaustive]
    pub enum RejectReason: u16;
    /// The client may only read.
    ReadOnly = 1, "the client has no control";
    /// The gateway or the channel does not exist or is not enabled.
    NoSuchChannel = 2, "no such channel";
    /// A CAN FD frame for a classic channel.
    NotFd = 3, "the channel is configured for classic CAN";
    /// The channel only receives.
    ReceiveOnly = 4, "the channel only receives";
    /// More frames without result than the window allows.
    Window = 5, "the window of the client is full";
    /// The queue of the channel, which all clients share, is full.
    QueueFull = 6, "the transmit queue of the channel is full";
    /// The gateway is not ready.
    NotReady = 7, "the gateway is not ready";
    /// The service ends, or the bus is configured again.
    Closed = 8, "the service or the session of the bus ended";
    /// The frame waited longer than its age limit.
    Expired = 9, "the frame waited longer than its age limit";
}

/// Event of a CAN frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum FrameEvent {
    /// Kind 0: received from the bus.
    Received,
    /// Kind 1: the transmit result is success.
    Transmitted,
    /// Kind 2: the transmit result is a failure.
    Failed(ResultCode),
    /// Kind 4: sent to a gateway that reports no transmit results.
    Published,
    /// Kind 5: rejected before it was sent. Only the client that sent it gets this record.
    Rejected(RejectReason),
    /// Kind 6: the transmit result is not known and will not be. The frame may have been sent, or may be
    /// sent later.
    Unknown,
}

/// Kind of a frame record, as filters and records name it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[repr(u8)]
enum Kind {
    Received = 0,
    Transmitted = 1,
    Failed = 2,
    Lost = 3,
    Published = 4,
    Rejected = 5,
    Unknown = 6,
}

impl FrameEvent {
    /// Number of the kind: 0, 1, 2, 4, 5 or 6.
    pub const fn kind(self) -> u8 {
        self.fields().0 as u8
    }

    const fn fields(self) -> (Kind, u16) {
        match self {
            Self::Received => (Kind::Received, 0),
            Self::Transmitted => (Kind::Transmitted, 0),
            Self::Failed(code) => (Kind::Failed, code.raw() as u16),
            Self::Published => (Kind::Published, 0),
            Self::Rejected(reason) => (Kind::Rejected, reason.raw()),
            Self::Unknown => (Kind::Unknown, 0),
        }
    }

    /// Returns whether the event ends a frame that a client sent: every one except a reception.
    pub const fn ends_transmission(self) -> bool {
        !matches!(self, Self::Received)
    }

    fn of(kind: u8, code: u16) -> Result<Self, RecordError> {
        Ok(match (kind, code) {
            (0, 0) => Self::Received,
            (1, 0) => Self::Transmitted,
            (2, code) => {
                let code = u8::try_from(code).map_err(|_| RecordError::Reserved)?;
                Self::Failed(ResultCode::from_raw(code))
            }
            (4, 0) => Self::Published,
            (5, code) => Self::Rejected(RejectReason::from_raw(code).ok_or(RecordError::Reserved)?),
            (6, 0) => Self::Unknown,
            (0 | 1 | 4 | 6, _) => return Err(RecordError::Reserved),
            _ => return Err(RecordError::Kind(kind)),
        })
    }
}

/// A CAN frame with its time, channel and event.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct FrameReport {
    /// Start of the cycle, in nanoseconds since 1970; since the start of the simulation in stepped
    /// time. For a rejected frame: 0.
    pub time_ns: u64,
    /// Index of the gateway.
    pub gateway: u16,
    /// Channel, 0 to 3.
    pub channel: u8,
    /// Tag that this client gave to its frame; 0 for every other frame.
    pub tag: u32,
    /// The event.
    pub event: FrameEvent,
    /// The frame.
    pub frame: CanFrame,
}

/// Entry of a frame batch.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FrameRecord {
    /// A frame.
    Frame(FrameReport),
    /// Kind 3: frames that this client lost, at this point of the stream.
    Lost {
        /// Time of the next frame, in nanoseconds; 0 if it is not known.
        time_ns: u64,
        /// Number of frames.
        frames: u32,
    },
}

impl FrameRecord {
    /// Appends the record to a batch.
    pub fn encode(&self, out: &mut Vec<u8>) {
        match self {
            Self::Frame(report) => report.encode(out),
            Self::Lost { time_ns, frames } => {
                push_head(out, *time_ns, (0, 0, 0), 0, 0, (Kind::Lost, 0), *frames);
            }
        }
    }
}

impl FrameReport {
    /// Appends the record of the frame to a batch.
    pub fn encode(&self, out: &mut Vec<u8>) {
        let fields = fields_of(&self.frame);
        let event = self.event.fields();
        push_head(out, self.time_ns, fields, self.gateway, self.channel, event, self.tag);
        push_data(&self.frame, out);
    }
}

fn push_head(
    out: &mut Vec<u8>,
    time_ns: u64,
    (can_id, length, flags): (u32, u8, u8),
    gateway: u16,
    channel: u8,
    (kind, code): (Kind, u16),
    tag: u32,
) {
    out.extend_from_slice(&time_ns.to_le_bytes());
    out.extend_from_slice(&can_id.to_le_bytes());
    out.extend_from_slice(&[length, flags]);
    out.extend_from_slice(&gateway.to_le_bytes());
    out.extend_from_slice(&[channel, kind as u8]);
    out.extend_from_slice(&code.to_le_bytes());
    out.extend_from_slice(&tag.to_le_bytes());
}

/// Records of a frame batch, in order. Ends after the first error.
#[derive(Debug, Clone)]
pub struct FrameRecords<'a> {
    rest: &'a [u8],
}

impl<'a> FrameRecords<'a> {
    /// Creates the reader of a batch.
    pub const fn new(batch: &'a [u8]) -> Self {
        Self { rest: batch }
    }

    fn read(&mut self) -> Result<FrameRecord, RecordError> {
        let incomplete = RecordError::Incomplete(self.rest.len());
        let (head, rest) = self.rest.split_first_chunk::<FRAME_RECORD_BYTES>().ok_or(incomplete)?;
        let [t0, t1, t2, t3, t4, t5, t6, t7, head @ ..] = *head;
        let [i0, i1, i2, i3, length, flags, g0, g1, channel, kind, c0, c1, a0, a1, a2, a3] = head;
        let time_ns = u64::from_le_bytes([t0, t1, t2, t3, t4, t5, t6, t7]);
        let can_id = u32::from_le_bytes([i0, i1, i2, i3]);
        let gateway = u16::from_le_bytes([g0, g1]);
        let code = u16::from_le_bytes([c0, c1]);
        let tag = u32::from_le_bytes([a0, a1, a2, a3]);
        if kind == Kind::Lost as u8 {
            if (can_id, length, flags, gateway, channel, code) != (0, 0, 0, 0, 0, 0) {
                return Err(RecordError::Reserved);
            }
            self.rest = rest;
            return Ok(FrameRecord::Lost { time_ns, frames: tag });
        }
        let event = FrameEvent::of(kind, code)?;
        check_channel(channel)?;
        let (frame, rest) = read_frame(can_id, length, flags, rest)?;
        self.rest = rest;
        Ok(FrameRecord::Frame(FrameReport { time_ns, gateway, channel, tag, event, frame }))
    }
}

impl Iterator for FrameRecords<'_> {
    type Item = Result<FrameRecord, RecordError>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.rest.is_empty() {
            return None;
        }
        Some(self.read().inspect_err(|_| self.rest = &[]))
    }
}

pub(crate) fn check_channel(channel: u8) -> Result<(), RecordError> {
    if usize::from(channel) < CHANNELS { Ok(()) } else { Err(RecordError::Channel(channel)) }
}
