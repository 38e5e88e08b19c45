//! Frames of the gs_usb protocol (`struct gs_host_frame`), little-endian.

use ecan_protocol::can::{CanFrame, CanId, Dlc, FrameKind};

use crate::bus_event::ErrorFrame;

/// Number of a frame that is not an echo.
const RECEIVED: [u8; 4] = [0xFF; 4];

const EXTENDED: u32 = 0x8000_0000;
const REMOTE: u32 = 0x4000_0000;
const ERROR: u32 = 0x2000_0000;

const OVERFLOW: u8 = 1;
const FD: u8 = 2;
const BRS: u8 = 4;
const ESI: u8 = 8;

/// Number by which the driver recognises the echo of its frame.
pub(super) type EchoId = [u8; 4];

/// Header, data and time stamp; data have 64 bytes for CAN FD, else 8.
fn assemble(echo: EchoId, id: u32, dlc: u8, flags: u8, data: &[u8], time_ns: u64) -> Vec<u8> {
    let size = if flags & FD != 0 { 64 } else { 8 };
    let mut bytes = Vec::with_capacity(80);
    bytes.extend(echo);
    bytes.extend(id.to_le_bytes());
    bytes.extend([dlc, 0, flags, 0]);
    bytes.extend(data.iter().take(size));
    bytes.resize(12 + size, 0);
    // The counter of the device has 32 bits of microseconds.
    bytes.extend(micros(time_ns).to_le_bytes());
    bytes
}

/// Time stamp counter of the device.
pub(super) fn micros(time_ns: u64) -> u32 {
    (time_ns / 1000) as u32
}

/// A frame for the driver: of the bus, or the echo of its own frame.
pub(super) fn encode(
    echo: Option<EchoId>,
    frame: &CanFrame,
    time_ns: u64,
    has_overflow: bool,
) -> Vec<u8> {
    let mut id = frame.id().raw();
    if frame.id().is_extended() {
        id |= EXTENDED;
    }
    let mut flags = if has_overflow { OVERFLOW } else { 0 };
    match frame.kind() {
        FrameKind::Data => {}
        FrameKind::Remote => id |= REMOTE,
        FrameKind::Fd { brs, esi } => {
            flags |= FD | if brs { BRS } else { 0 } | if esi { ESI } else { 0 };
        }
    }
    let dlc = frame.dlc().value();
    assemble(echo.unwrap_or(RECEIVED), id, dlc, flags, frame.data(), time_ns)
}

/// An error frame for the driver.
pub(super) fn encode_error(error: ErrorFrame, time_ns: u64) -> Vec<u8> {
    assemble(RECEIVED, error.class | ERROR, 8, 0, &error.data, time_ns)
}

/// A frame of the driver with its number; `None` if it is invalid.
pub(super) fn decode(bytes: &[u8]) -> Option<(EchoId, CanFrame)> {
    let (echo, rest) = bytes.split_first_chunk()?;
    let (id, rest) = rest.split_first_chunk()?;
    let ([dlc, _channel, flags, _reserved], data) = rest.split_first_chunk()?;
    let raw = u32::from_le_bytes(*id);
    let id = CanId::new(raw & 0x1FFF_FFFF, raw & EXTENDED != 0).ok()?;
    let dlc = Dlc::new(*dlc)?;
    let frame = if flags & FD != 0 {
        let data = data.get(..dlc.fd_len())?;
        CanFrame::fd(id, data, flags & BRS != 0, flags & ESI != 0).ok()?
    } else if raw & REMOTE != 0 {
        CanFrame::remote(id, dlc).ok()?
    } else {
        CanFrame::classic(id, data.get(..dlc.classic_len())?).ok()?
    };
    Some((*echo, frame))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::frame_strategies::any_frame;

    proptest! {
        #[test]
        fn frames_survive_encoding(frame in any_frame(true), echo: [u8; 4]) {
            let bytes = encode(Some(echo), &frame, 0, false);
            prop_assert_eq!(bytes.len(), if frame.is_fd() { 80 } else { 24 });
            prop_assert_eq!(decode(&bytes), Some((echo, frame)));
        }
    }

    #[test]
    fn layout_matches_driver() {
        let id = CanId::extended(0x1234_5678).unwrap();
        let frame = CanFrame::fd(id, &[7; 12], true, false).unwrap();
        let bytes = encode(None, &frame, 5_000, true);
        assert_eq!(bytes[..12], [255, 255, 255, 255, 0x78, 0x56, 0x34, 0x92, 9, 0, 7, 0]);
        assert_eq!((&bytes[12..24], &bytes[76..]), (&[7; 12][..], &[5, 0, 0, 0][..]));
        let error = ErrorFrame { class: 0x40, data: [0; 8] };
        let bytes = encode_error(error, 0);
        assert_eq!(bytes[4..12], [0x40, 0, 0, 0x20, 8, 0, 0, 0]);
        assert_eq!(decode(&[0; 11]), None);
    }
}
