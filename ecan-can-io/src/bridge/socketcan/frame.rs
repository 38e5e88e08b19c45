//! Conversion between frames of the kernel (`linux/can.h`) and of the bus.

use ecan_protocol::can::{CanFrame, CanId, Dlc, FrameKind};
use socketcan::id::FdFlags;
use socketcan::{
    CanAnyFrame, CanDataFrame, CanErrorFrame, CanFdFrame, CanRemoteFrame, EmbeddedFrame as _,
    ExtendedId, Id, StandardId,
};

use crate::bridge::bus_event::ErrorFrame;

/// A frame for the kernel; `None` if the kernel has no such frame.
pub(super) fn to_kernel(frame: &CanFrame) -> Option<CanAnyFrame> {
    let raw = frame.id().raw();
    let id: Id = match frame.id().is_extended() {
        true => ExtendedId::new(raw)?.into(),
        false => StandardId::new(u16::try_from(raw).ok()?)?.into(),
    };
    match frame.kind() {
        FrameKind::Data => CanDataFrame::new(id, frame.data()).map(Into::into),
        FrameKind::Remote => {
            CanRemoteFrame::new_remote(id, frame.dlc().value().into()).map(Into::into)
        }
        FrameKind::Fd { brs, esi } => {
            let mut flags = FdFlags::FDF;
            flags.set(FdFlags::BRS, brs);
            flags.set(FdFlags::ESI, esi);
            CanFdFrame::with_flags(id, frame.data(), flags).map(Into::into)
        }
    }
}

/// An error frame for the kernel.
pub(super) fn error_to_kernel(error: ErrorFrame) -> Option<CanAnyFrame> {
    CanErrorFrame::new_error(error.class, &error.data).ok().map(Into::into)
}

/// A frame for the bus; `None` for an error frame. A CAN FD frame whose length has no DLC is padded
/// with zeros, as by the kernel's drivers.
pub(super) fn from_kernel(frame: &CanAnyFrame) -> Option<CanFrame> {
    let id = |id: Id| match id {
        Id::Standard(id) => CanId::standard(id.as_raw()).ok(),
        Id::Extended(id) => CanId::extended(id.as_raw()).ok(),
    };
    match frame {
        CanAnyFrame::Normal(frame) => CanFrame::classic(id(frame.id())?, frame.data()).ok(),
        CanAnyFrame::Remote(frame) => {
            CanFrame::remote(id(frame.id())?, Dlc::from_classic_len(frame.dlc())?).ok()
        }
        CanAnyFrame::Fd(frame) => {
            CanFrame::fd(id(frame.id())?, frame.data(), frame.is_brs(), frame.is_esi()).ok()
        }
        CanAnyFrame::Error(_) => None,
    }
}
