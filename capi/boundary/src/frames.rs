//! CAN frames

use std::ffi::c_int;

use ecan_protocol::can::{CanId, Dlc, FrameError, FrameKind, FrameRef};
use ecan_protocol::image::{FramePacket, PushError, Schedule, Timestamp, TxResult};

use crate::result::ecan_result_t;
use crate::{Call, ToResult};

/// Flag: 29-bit identifier.
pub const IGH_MCAN_FLAG_EXT: u8 = 1;
/// Flag: remote frame, classic CAN only. Its length is the requested DLC; it has no data.
pub const IGH_MCAN_FLAG_RTR: u8 = 2;
/// Flag: CAN FD frame with bit rate switch.
pub const IGH_MCAN_FLAG_BRS: u8 = 4;
/// Flag: CAN FD frame with the error state indicator.
pub const IGH_MCAN_FLAG_ESI: u8 = 8;
/// Flag: CAN FD frame. Set by the _canfd functions and in received frames.
pub const IGH_MCAN_FLAG_FD: u8 = 16;

/// Hint for the gateway's transmit path (manual 8.1), in igh_mcan_tx_frame_t.hint.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum igh_mcan_hint_t {
    /// No preference.
    IGH_MCAN_HINT_NORMAL = 0,
    /// High priority.
    IGH_MCAN_HINT_HIGH_PRIORITY = 1,
    /// A dedicated TX buffer.
    IGH_MCAN_HINT_BUFFER = 2,
    /// The TX queue, sorted by identifier.
    IGH_MCAN_HINT_QUEUE = 3,
}

/// Buffer of the gateway's CAN controller that held a received frame (manual 8.1), in
/// igh_mcan_rx_frame_t.source.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum igh_mcan_source_t {
    /// RX FIFO 0.
    IGH_MCAN_SOURCE_FIFO0 = 0,
    /// RX FIFO 1.
    IGH_MCAN_SOURCE_FIFO1 = 1,
    /// A dedicated RX buffer.
    IGH_MCAN_SOURCE_BUFFER = 2,
    /// Marked as a high priority message.
    IGH_MCAN_SOURCE_HIGH_PRIORITY = 3,
}

/// Kind of a received item, in igh_mcan_rx_frame_t.kind.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum igh_mcan_rx_kind_t {
    /// A CAN frame from the bus.
    IGH_MCAN_RX_FRAME = 0,
    /// The result of a transmission (manual 10).
    IGH_MCAN_RX_TX_RESULT = 1,
}

/// Format of igh_mcan_rx_frame_t.timestamp (manual 8.4). The manual gives no unit.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum igh_mcan_timestamp_t {
    /// None: other profiles than 1 and 5.
    IGH_MCAN_TIMESTAMP_NONE = 0,
    /// Low 16 bits of the difference to the image's time base.
    IGH_MCAN_TIMESTAMP_DELTA16 = 1,
    /// Low 32 bits of the difference to the image's time base.
    IGH_MCAN_TIMESTAMP_DELTA32 = 2,
    /// The whole time.
    IGH_MCAN_TIMESTAMP_FULL64 = 3,
}

/// Result of a transmission (manual 10), in igh_mcan_rx_frame_t.result. It covers the path into the
/// CAN controller, not the reception by a node. The device may report other values.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum igh_mcan_tx_result_t {
    /// Passed to the CAN controller.
    IGH_MCAN_TX_RESULT_OK = 0,
    /// Waits in the gateway's transmit queue.
    IGH_MCAN_TX_RESULT_QUEUED = 1,
    /// The bus is busy.
    IGH_MCAN_TX_RESULT_BUS_BUSY = 2,
    /// The frame's channel does not exist or is not enabled.
    IGH_MCAN_TX_RESULT_INVALID_CHANNEL = 3,
    /// The transmit FIFO is full.
    IGH_MCAN_TX_RESULT_FIFO_FULL = 4,
    /// The channel is bus-off.
    IGH_MCAN_TX_RESULT_BUS_OFF = 5,
}

/// A frame to send, with its destination. Filled by the igh_mcan_tx_frame_set functions, or by the
/// application, which sets it to zero first.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct igh_mcan_tx_frame_t {
    /// Slave index.
    pub slave: u16,
    /// Channel of the gateway, 0 to 3.
    pub channel: u8,
    /// IGH_MCAN_FLAG_ values.
    pub flags: u8,
    /// CAN ID, 11 or 29 bits.
    pub can_id: u32,
    /// Data bytes; the DLC of a remote frame.
    pub len: u8,
    /// An igh_mcan_hint_t.
    pub hint: u8,
    /// Not 0: sent offset_ns into the next Sync0 period (manual 8.4).
    pub scheduled: u8,
    /// Must be 0; for fields of later versions.
    pub reserved: u8,
    /// Phase of Sync0, in nanoseconds.
    pub offset_ns: u32,
    /// Tag of the application for a scheduled frame.
    pub tag: u16,
    /// Must be 0; for fields of later versions.
    pub reserved2: u16,
    /// Data.
    pub data: [u8; 64],
    /// Must be 0; for fields of later versions.
    pub reserved3: [u32; 3],
}

/// A received frame, or the result of a transmission.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct igh_mcan_rx_frame_t {
    /// Slave index.
    pub slave: u16,
    /// Channel of the gateway, 0 to 3.
    pub channel: u8,
    /// IGH_MCAN_FLAG_ values.
    pub flags: u8,
    /// CAN ID, 11 or 29 bits.
    pub can_id: u32,
    /// Data bytes; the DLC of a remote frame.
    pub len: u8,
    /// An igh_mcan_rx_kind_t: frame or TX_RESULT.
    pub kind: u8,
    /// An igh_mcan_source_t.
    pub source: u8,
    /// Format of the timestamp, an igh_mcan_timestamp_t.
    pub timestamp_format: u8,
    /// TX_RESULT: an igh_mcan_tx_result_t.
    pub result: u8,
    /// TX_RESULT: index of the frame in its image, from 0.
    pub frame_index: u8,
    /// TX_RESULT: sequence of the image in which the frame was sent.
    pub sequence: u16,
    /// TX_RESULT: 1 if this SDK sent such a frame, else 0.
    pub is_known: u8,
    /// Zero; for fields of later versions.
    pub reserved: [u8; 7],
    /// Time at which the gateway received the frame.
    pub timestamp: u64,
    /// Data; bytes after len are 0.
    pub data: [u8; 64],
}

impl ToResult for FrameError {
    fn result(&self) -> ecan_result_t {
        ecan_result_t::ECAN_ERR_FRAME
    }
}

/// Makes a classic CAN frame of the arguments of C, or returns `ECAN_ERR_FRAME`.
#[inline(always)]
pub fn classic_frame(
    call: Call,
    can_id: u32,
    flags: u8,
    data: &[u8],
) -> Result<FrameRef<'_>, ecan_result_t> {
    known_flags(call, flags, IGH_MCAN_FLAG_EXT | IGH_MCAN_FLAG_RTR, "a classic CAN frame")?;
    let id = CanId::new(can_id, flags & IGH_MCAN_FLAG_EXT != 0).map_err(|e| call.error(&e))?;
    let frame = if flags & IGH_MCAN_FLAG_RTR == 0 {
        FrameRef::classic(id, data)
    } else {
        let length = FrameError::RemoteDlc { dlc: data.len() as u8 };
        Dlc::from_classic_len(data.len()).ok_or(length).and_then(|dlc| FrameRef::remote(id, dlc))
    };
    frame.map_err(|e| call.error(&e))
}

/// As [`classic_frame`]; the data of a remote frame may be NULL.
///
/// # Safety
/// As for [`Call::items`], but for a remote frame.
#[inline(always)]
pub unsafe fn classic_frame_at<'a>(
    call: Call,
    can_id: u32,
    flags: u8,
    data: *const u8,
    len: usize,
) -> Result<FrameRef<'a>, ecan_result_t> {
    let data = if flags & IGH_MCAN_FLAG_RTR != 0 {
        &[0; 255][..len.min(255)]
    } else {
        // SAFETY: the caller's promise.
        unsafe { call.items("data", data, len)? }
    };
    classic_frame(call, can_id, flags, data)
}

/// Makes a CAN FD frame of the arguments of C, or returns `ECAN_ERR_FRAME`.
#[inline]
pub fn fd_frame(
    call: Call,
    can_id: u32,
    flags: u8,
    data: &[u8],
) -> Result<FrameRef<'_>, ecan_result_t> {
    let known = IGH_MCAN_FLAG_EXT | IGH_MCAN_FLAG_BRS | IGH_MCAN_FLAG_ESI | IGH_MCAN_FLAG_FD;
    known_flags(call, flags, known, "a CAN FD frame")?;
    let id = CanId::new(can_id, flags & IGH_MCAN_FLAG_EXT != 0).map_err(|e| call.error(&e))?;
    let (brs, esi) = (flags & IGH_MCAN_FLAG_BRS != 0, flags & IGH_MCAN_FLAG_ESI != 0);
    FrameRef::fd(id, data, brs, esi).map_err(|e| call.error(&e))
}

#[inline]
fn known_flags(call: Call, flags: u8, known: u8, what: &str) -> Result<(), ecan_result_t> {
    if flags & !known == 0 {
        return Ok(());
    }
    let unknown = flags & !known;
    let text = format_args!("flags 0x{unknown:02X} are not allowed for {what}");
    Err(call.fail(ecan_result_t::ECAN_ERR_FRAME, text))
}

impl igh_mcan_tx_frame_t {
    /// Frame that C describes, or `ECAN_ERR_FRAME`.
    #[inline]
    pub fn frame(&self, call: Call) -> Result<FrameRef<'_>, ecan_result_t> {
        let [a, b, c] = self.reserved3;
        call.reserved("frame", &[self.reserved.into(), self.reserved2.into(), a, b, c])?;
        let fd = self.flags & IGH_MCAN_FLAG_FD != 0;
        let length = FrameError::Length { length: self.len.into(), fd };
        let data = self.data.get(..usize::from(self.len)).ok_or(length);
        let data = data.map_err(|e| call.error(&e))?;
        let make = if fd { fd_frame } else { classic_frame };
        make(call, self.can_id, self.flags, data)
    }

    /// The hint, an [`igh_mcan_hint_t`], or `ECAN_ERR_ARGUMENT`.
    #[inline]
    pub fn checked_hint(&self, call: Call) -> Result<u8, ecan_result_t> {
        check_hint(call, self.hint.into())
    }

    /// Schedule of the frame; `None` if it is sent at once.
    #[inline]
    pub fn schedule(&self) -> Option<Schedule> {
        (self.scheduled != 0).then_some(Schedule { tag: self.tag, offset_ns: self.offset_ns })
    }

    /// All zero: of no frame, sent at once.
    pub const EMPTY: Self = Self {
        slave: 0,
        channel: 0,
        flags: 0,
        can_id: 0,
        len: 0,
        hint: 0,
        scheduled: 0,
        reserved: 0,
        offset_ns: 0,
        tag: 0,
        reserved2: 0,
        data: [0; 64],
        reserved3: [0; 3],
    };

    /// Frame that is sent at once.
    pub fn from_frame(slave: u16, channel: u8, frame: FrameRef<'_>) -> Self {
        let (flags, can_id, len) = (flags_of(frame), frame.id().raw(), length_of(frame));
        Self { slave, channel, flags, can_id, len, data: frame.padded_data(), ..Self::EMPTY }
    }
}

#[inline(always)]
fn flags_of(frame: FrameRef<'_>) -> u8 {
    let ext = if frame.id().is_extended() { IGH_MCAN_FLAG_EXT } else { 0 };
    ext | match frame.kind() {
        FrameKind::Data => 0,
        FrameKind::Remote => IGH_MCAN_FLAG_RTR,
        FrameKind::Fd { brs, esi } => {
            IGH_MCAN_FLAG_FD
                | if brs { IGH_MCAN_FLAG_BRS } else { 0 }
                | if esi { IGH_MCAN_FLAG_ESI } else { 0 }
        }
    }
}

#[inline(always)]
fn length_of(frame: FrameRef<'_>) -> u8 {
    match frame.kind() {
        FrameKind::Remote => frame.dlc().value(),
        _ => frame.data().len() as u8,
    }
}

impl igh_mcan_rx_frame_t {
    /// All zero.
    pub const EMPTY: Self = Self {
        slave: 0,
        channel: 0,
        flags: 0,
        can_id: 0,
        len: 0,
        kind: 0,
        source: 0,
        timestamp_format: 0,
        result: 0,
        frame_index: 0,
        sequence: 0,
        is_known: 0,
        reserved: [0; 7],
        timestamp: 0,
        data: [0; 64],
    };

    /// Converts a received frame.
    #[inline(always)]
    pub fn from_frame(
        slave: usize,
        channel: u8,
        frame: FrameRef<'_>,
        timestamp: Timestamp,
        source: u8,
    ) -> Self {
        Self {
            slave: slave as u16,
            channel,
            flags: flags_of(frame),
            can_id: frame.id().raw(),
            len: length_of(frame),
            kind: igh_mcan_rx_kind_t::IGH_MCAN_RX_FRAME as u8,
            source,
            timestamp_format: timestamp.format(),
            result: 0,
            frame_index: 0,
            sequence: 0,
            is_known: 0,
            reserved: [0; 7],
            timestamp: match timestamp {
                Timestamp::None => 0,
                Timestamp::Delta16(time) => time.into(),
                Timestamp::Delta32(time) => time.into(),
                Timestamp::Full64(time) => time,
            },
            data: frame.padded_data(),
        }
    }

    /// Converts a frame of an image.
    #[inline(always)]
    pub fn from_packet(slave: usize, packet: &FramePacket<'_>) -> Self {
        Self::from_frame(slave, packet.channel, packet.frame, packet.timestamp, packet.id_aux)
    }

    /// Converts the result of a transmission.
    pub fn from_result(slave: usize, result: &TxResult, is_known: bool) -> Self {
        Self {
            slave: slave as u16,
            channel: result.channel,
            kind: igh_mcan_rx_kind_t::IGH_MCAN_RX_TX_RESULT as u8,
            result: result.code.raw(),
            frame_index: result.frame_index,
            sequence: result.sequence,
            is_known: is_known.into(),
            ..Self::EMPTY
        }
    }
}

impl ToResult for PushError {
    fn result(&self) -> ecan_result_t {
        match self {
            Self::NoRoom { .. } | Self::TooManyPackets => ecan_result_t::ECAN_ERR_NO_ROOM,
            Self::Channel { .. } => ecan_result_t::ECAN_ERR_CHANNEL,
            Self::Buffer { .. } => ecan_result_t::ECAN_ERR_BUFFER,
            _ => ecan_result_t::ECAN_ERR_ARGUMENT,
        }
    }
}

/// Checks a hint, an [`igh_mcan_hint_t`].
#[inline]
pub fn check_hint(call: Call, hint: c_int) -> Result<u8, ecan_result_t> {
    match hint {
        0..=3 => Ok(hint as u8),
        _ => Err(call.argument("hint", format_args!("{hint} is out of range; allowed: 0 to 3"))),
    }
}
