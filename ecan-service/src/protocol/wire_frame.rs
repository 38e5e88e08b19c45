//! CAN frames in records: bits of CAN ID and flags as in `linux/can.h`.

use ecan_protocol::can::{CanFrame, CanId, Dlc, FrameError, FrameKind};
use thiserror::Error;

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
            let dlc = Dlc::new(length).ok_or(FrameError::RemoteDlc { dlc: length })?;
            CanFrame::remote(id, dlc)?
        }
        (false, true) => CanFrame::fd(id, data, flags & CANFD_BRS != 0, flags & CANFD_ESI != 0)?,
        (false, false) => CanFrame::classic(id, data)?,
    };
    Ok((frame, rest))
}
