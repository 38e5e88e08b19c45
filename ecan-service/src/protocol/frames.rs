//! Records of CAN frames in both directions, and images of process data.

use ecan_protocol::can::{CanFrame, CanId, Dlc, FrameError, FrameKind};
use ecan_protocol::image::{
    BudgetPolicy, EncapsulationProfile, OptionFlags, PdoProfile, ResultCode,
};
use ecan_protocol::mapping::{CHANNELS, Direction};
use thiserror::Error;

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

/// Bytes of a record without its data.
pub const TRANSMIT_RECORD_BYTES: usize = 16;

/// A frame to send.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct TransmitRecord {
    /// Index of the gateway.
    pub gateway: u16,
    /// Channel, 0 to 3.
    pub channel: u8,
    /// Tag of the frame records that report on it; not 0.
    pub tag: u32,
    /// Age limit in milliseconds, counted from the arrival at the service: a frame that waits longer is
    /// rejected. 0 for [`DEFAULT_MAX_AGE_MS`](super::DEFAULT_MAX_AGE_MS).
    pub max_age_ms: u16,
    /// The frame.
    pub frame: CanFrame,
}

impl TransmitRecord {
    /// Appends the record to a batch.
    pub fn encode(&self, out: &mut Vec<u8>) {
        let (can_id, length, flags) = fields_of(&self.frame);
        out.extend_from_slice(&can_id.to_le_bytes());
        out.extend_from_slice(&[length, flags]);
        out.extend_from_slice(&self.gateway.to_le_bytes());
        out.extend_from_slice(&[self.channel, 0]);
        out.extend_from_slice(&self.max_age_ms.to_le_bytes());
        out.extend_from_slice(&self.tag.to_le_bytes());
        push_data(&self.frame, out);
    }
}

/// Records of a transmit batch, in order. Ends after the first error.
#[derive(Debug, Clone)]
pub struct TransmitRecords<'a> {
    rest: &'a [u8],
}

impl<'a> TransmitRecords<'a> {
    /// Creates the reader of a batch.
    pub const fn new(batch: &'a [u8]) -> Self {
        Self { rest: batch }
    }

    fn read(&mut self) -> Result<TransmitRecord, RecordError> {
        let incomplete = RecordError::Incomplete(self.rest.len());
        let (head, rest) =
            self.rest.split_first_chunk::<TRANSMIT_RECORD_BYTES>().ok_or(incomplete)?;
        let [i0, i1, i2, i3, length, flags, g0, g1, channel, reserved, m0, m1, a0, a1, a2, a3] =
            *head;
        if reserved != 0 {
            return Err(RecordError::Reserved);
        }
        let tag = u32::from_le_bytes([a0, a1, a2, a3]);
        if tag == 0 {
            return Err(RecordError::Tag);
        }
        check_channel(channel)?;
        let can_id = u32::from_le_bytes([i0, i1, i2, i3]);
        let (frame, rest) = read_frame(can_id, length, flags, rest)?;
        self.rest = rest;
        let (gateway, max_age_ms) = (u16::from_le_bytes([g0, g1]), u16::from_le_bytes([m0, m1]));
        Ok(TransmitRecord { gateway, channel, tag, max_age_ms, frame })
    }
}

impl Iterator for TransmitRecords<'_> {
    type Item = Result<TransmitRecord, RecordError>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.rest.is_empty() {
            return None;
        }
        Some(self.read().inspect_err(|_| self.rest = &[]))
    }
}

/// The CAN ID has 29 bits.
pub const CAN_EFF_FLAG: u32 = 1 << 31;
/// A remote frame.
pub const CAN_RTR_FLAG: u32 = 1 << 30;
/// An error frame; no frame of this protocol has it.
pub const CAN_ERR_FLAG: u32 = 1 << 29;
/// Bit rate switch of a CAN FD frame.
pub const CANFD_BRS: u8 = 1;
/// Error state indicator of a CAN FD frame.
pub const CANFD_ESI: u8 = 2;
/// A CAN FD frame.
pub const CANFD_FDF: u8 = 4;

/// Fault of a record. The records after it cannot be read.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
pub enum RecordError {
    /// Bytes are missing.
    #[error("record is incomplete: {0} bytes left in the message; send whole records")]
    Incomplete(usize),
    /// A kind that does not exist.
    #[error("record kind {0} is unknown; allowed: 0 to 6")]
    Kind(u8),
    /// A channel that does not exist.
    #[error("channel {0} is out of range; allowed: 0 to 3")]
    Channel(u8),
    /// The CAN ID has an unknown bit.
    #[error("CAN ID field {0:#010x} is invalid; allowed: 11 bits, or 29 bits with CAN_EFF_FLAG")]
    CanId(u32),
    /// Unknown flags, or flags of CAN FD without CANFD_FDF.
    #[error(
        "frame flags {0:#04x} are invalid; allowed: 0, or CANFD_FDF (4) with BRS (1) and ESI (2)"
    )]
    Flags(u8),
    /// A CAN FD remote frame.
    #[error("CAN FD has no remote frames; clear CAN_RTR_FLAG or CANFD_FDF")]
    RemoteFd,
    /// A reserved or padding byte is not zero, or a field that the kind does not use.
    #[error("reserved bytes or unused fields of a record are not 0")]
    Reserved,
    /// The tag of a frame to send is 0.
    #[error("tag 0 is not allowed; allowed: 1 to 4294967295")]
    Tag,
    /// The data length is not that of a CAN frame.
    #[error(transparent)]
    Frame(#[from] FrameError),
}

/// CAN ID, length and flags of a frame.
pub(crate) fn fields_of(frame: &CanFrame) -> (u32, u8, u8) {
    let id = frame.id();
    let format = if id.is_extended() { CAN_EFF_FLAG } else { 0 };
    let (remote, flags) = match frame.kind() {
        FrameKind::Data => (0, 0),
        FrameKind::Remote => (CAN_RTR_FLAG, 0),
        FrameKind::Fd { brs, esi } => {
            let brs = if brs { CANFD_BRS } else { 0 };
            (0, CANFD_FDF | brs | if esi { CANFD_ESI } else { 0 })
        }
    };
    // No length is above 64.
    (id.raw() | format | remote, frame.len() as u8, flags)
}

pub(crate) fn push_data(frame: &CanFrame, out: &mut Vec<u8>) {
    let data = frame.data();
    out.extend_from_slice(data);
    out.resize(out.len() + padding(data.len()), 0);
}

const fn padding(length: usize) -> usize {
    length.wrapping_neg() % 8
}

/// Reads a frame whose data begin `rest`; returns the bytes after it.
pub(crate) fn read_frame(
    can_id: u32,
    length: u8,
    flags: u8,
    rest: &[u8],
) -> Result<(CanFrame, &[u8]), RecordError> {
    let is_extended = can_id & CAN_EFF_FLAG != 0;
    let is_remote = can_id & CAN_RTR_FLAG != 0;
    let raw = can_id & !(CAN_EFF_FLAG | CAN_RTR_FLAG);
    let id = CanId::new(raw, is_extended).map_err(|_| RecordError::CanId(can_id))?;
    let is_fd = flags & CANFD_FDF != 0;
    if flags > (CANFD_BRS | CANFD_ESI | CANFD_FDF) || !is_fd && flags != 0 {
        return Err(RecordError::Flags(flags));
    }
    let data_bytes = if is_remote { 0 } else { usize::from(length) };
    let incomplete = RecordError::Incomplete(rest.len());
    let (data, rest) = rest.split_at_checked(data_bytes).ok_or(incomplete)?;
    let (zeros, rest) = rest.split_at_checked(padding(data_bytes)).ok_or(incomplete)?;
    if zeros.iter().any(|byte| *byte != 0) {
        return Err(RecordError::Reserved);
    }
    let frame = match (is_remote, is_fd) {
        (true, true) => return Err(RecordError::RemoteFd),
        (true, false) => {
            let dlc = Dlc::from_raw(length).ok_or(FrameError::RemoteDlc { dlc: length })?;
            CanFrame::remote(id, dlc)?
        }
        (false, true) => CanFrame::fd(id, data, flags & CANFD_BRS != 0, flags & CANFD_ESI != 0)?,
        (false, false) => CanFrame::classic(id, data)?,
    };
    Ok((frame, rest))
}

/// Bytes before the image.
pub const IMAGE_HEAD_BYTES: usize = 32;

/// A PDO image with its time and profile.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ImageMessage<'a> {
    /// Start of the cycle, as in a frame record.
    pub time_ns: u64,
    /// Number of the cycle.
    pub cycle: u64,
    /// Images that this client lost before this one.
    pub lost: u32,
    /// Index of the gateway.
    pub gateway: u16,
    /// Direction of the image.
    pub direction: Direction,
    /// Profile of the image.
    pub profile: PdoProfile,
    /// The image: 128 bytes times the multiplier of the profile.
    pub image: &'a [u8],
}

impl<'a> ImageMessage<'a> {
    /// Appends the payload of the message.
    pub fn encode(&self, out: &mut Vec<u8>) {
        let PdoProfile { multiplier, channel_mask, profile, budget, options } = self.profile;
        let direction = match self.direction {
            Direction::TxPdo => 0,
            Direction::RxPdo => 1,
        };
        out.extend_from_slice(&self.time_ns.to_le_bytes());
        out.extend_from_slice(&self.cycle.to_le_bytes());
        out.extend_from_slice(&self.lost.to_le_bytes());
        out.extend_from_slice(&self.gateway.to_le_bytes());
        out.extend_from_slice(&[direction, multiplier, channel_mask]);
        out.extend_from_slice(&[profile.raw(), budget.raw(), options.bits(), 0, 0, 0, 0]);
        out.extend_from_slice(self.image);
    }

    /// Reads the payload of a message.
    ///
    /// # Errors
    /// [`RecordError`]: bytes are missing, or a field has a value that does not exist.
    pub fn decode(payload: &'a [u8]) -> Result<Self, RecordError> {
        let incomplete = RecordError::Incomplete(payload.len());
        let (times, rest) = payload.split_first_chunk::<16>().ok_or(incomplete)?;
        let (fields, image) = rest.split_first_chunk::<16>().ok_or(incomplete)?;
        let [time_ns, cycle] = *times.as_chunks::<8>().0 else { return Err(incomplete) };
        let [l0, l1, l2, l3, g0, g1, direction, multiplier, channel_mask, fields @ ..] = *fields;
        let [profile, budget, options, reserved @ ..] = fields;
        let direction = match direction {
            0 => Direction::TxPdo,
            1 => Direction::RxPdo,
            _ => return Err(RecordError::Reserved),
        };
        let profile = PdoProfile {
            multiplier,
            channel_mask,
            profile: EncapsulationProfile::from_raw(profile).ok_or(RecordError::Reserved)?,
            budget: BudgetPolicy::from_raw(budget).ok_or(RecordError::Reserved)?,
            options: OptionFlags::from_bits(options).ok_or(RecordError::Reserved)?,
        };
        if reserved != [0; 4] || profile.check(direction).is_err() {
            return Err(RecordError::Reserved);
        }
        if image.len() != profile.pdo_bytes() {
            return Err(incomplete);
        }
        Ok(Self {
            time_ns: u64::from_le_bytes(time_ns),
            cycle: u64::from_le_bytes(cycle),
            lost: u32::from_le_bytes([l0, l1, l2, l3]),
            gateway: u16::from_le_bytes([g0, g1]),
            direction,
            profile,
            image,
        })
    }
}
