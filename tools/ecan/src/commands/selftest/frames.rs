//! Frames of a test; the CAN ID contains the sender and the number.

use ecan_protocol::can::{CanFrame, CanId, FrameError, FrameKind};

pub(super) const MOST: u16 = 256;
const EXTENDED: u32 = 0x1555_0000;
const CLASSIC_LENGTHS: [usize; 9] = [8, 0, 1, 2, 3, 4, 5, 6, 7];
const FD_LENGTHS: [usize; 16] = [64, 0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48];

/// Frame `number` of a channel: all lengths, both kinds of CAN IDs and, with CAN FD, classic and
/// CAN FD frames with and without bit rate switch.
pub(super) fn frame(channel: u8, number: u16, is_fd: bool) -> Result<CanFrame, FrameError> {
    let raw = u16::from(channel) << 8 | number & 0xFF;
    let id = match number % 2 {
        0 => CanId::standard(raw),
        _ => CanId::extended(EXTENDED | u32::from(raw)),
    };
    let kind = if is_fd { number / 2 % 3 } else { 0 };
    let step = usize::from(if is_fd { number / 6 } else { number / 2 });
    let lengths = if kind == 0 { &CLASSIC_LENGTHS[..] } else { &FD_LENGTHS[..] };
    let length = lengths.get(step % lengths.len()).copied().unwrap_or_default();
    let mut data = [0; 64];
    let bytes = data.get_mut(..length).unwrap_or_default();
    for (at, byte) in bytes.iter_mut().enumerate() {
        *byte = pattern(channel, number, at);
    }
    match kind {
        0 => CanFrame::classic(id?, bytes),
        kind => CanFrame::fd(id?, bytes, kind == 1, false),
    }
}

/// The data alternate between bit patterns that stress stuffing and transceivers, and patterns that
/// make each byte of each frame unique.
fn pattern(channel: u8, number: u16, at: usize) -> u8 {
    match number / 2 % 5 {
        0 => 0x00,
        1 => 0xFF,
        2 => [0x55, 0xAA][at % 2],
        _ => {
            let seed = u32::from(channel) << 16 | u32::from(number) << 8 | at as u32 & 0xFF;
            (seed.wrapping_mul(0x9E37_79B1) >> 24) as u8
        }
    }
}

/// Sender and number of a frame; `None` for a frame that is not from a test.
pub(super) fn origin(frame: &CanFrame) -> Option<(u8, u16)> {
    let (id, is_extended) = (frame.id().raw(), frame.id().is_extended());
    let raw = if is_extended { id.checked_sub(EXTENDED)? } else { id };
    let channel = u8::try_from(raw >> 8)
        .ok()
        .filter(|it| usize::from(*it) < ecan_protocol::mapping::CHANNELS);
    let number = (raw & 0xFF) as u16;
    let is_kind = is_extended == (number % 2 == 1);
    channel.filter(|_| is_kind).map(|channel| (channel, number))
}

/// Returns the difference between a sent and a received frame. Ignores the ESI bit, because the
/// error counters show error states.
pub(super) fn difference(sent: &CanFrame, came: &CanFrame) -> Option<String> {
    let kind = |frame: &CanFrame| match frame.kind() {
        FrameKind::Data => "a classic frame",
        FrameKind::Remote => "a remote frame",
        FrameKind::Fd { brs: true, .. } => "a CAN FD frame with bit rate switch",
        FrameKind::Fd { brs: false, .. } => "a CAN FD frame without bit rate switch",
    };
    if kind(sent) != kind(came) {
        return Some(format!("sent {}, received {}", kind(sent), kind(came)));
    }
    let (sent, came) = (sent.data(), came.data());
    if sent.len() != came.len() {
        return Some(format!("sent {} bytes, received {}", sent.len(), came.len()));
    }
    let (at, (sent, came)) = sent.iter().zip(came).enumerate().find(|(_, (a, b))| a != b)?;
    Some(format!("byte {at}: sent 0x{sent:02X}, received 0x{came:02X}"))
}

#[cfg(test)]
mod tests {
    use std::collections::HashSet;

    use super::*;

    #[test]
    fn frames_cover_every_kind_and_identify_the_sender() {
        let mut kinds = HashSet::new();
        for (channel, number) in (0..4).flat_map(|channel| (0..MOST).map(move |it| (channel, it))) {
            let classic = frame(channel, number, false).unwrap();
            assert_eq!(origin(&classic), Some((channel, number)));
            assert!(!classic.is_fd());
            let fd = frame(channel, number, true).unwrap();
            assert_eq!(origin(&fd), Some((channel, number)));
            kinds.insert((fd.kind(), fd.data().len(), fd.id().is_extended()));
        }
        // Two kinds of CAN IDs; 9 lengths of classic frames, 16 of each kind of CAN FD.
        assert_eq!(kinds.len(), 2 * (9 + 16 + 16));
    }

    #[test]
    fn differences_are_described() {
        let id = CanId::standard(0x100).unwrap();
        let one = CanFrame::classic(id, &[1, 2]).unwrap();
        let says = |other: CanFrame| difference(&one, &other);
        assert_eq!(says(one), None);
        let message = "byte 1: sent 0x02, received 0x06";
        assert_eq!(says(CanFrame::classic(id, &[1, 6]).unwrap()).as_deref(), Some(message));
        let message = "sent 2 bytes, received 1";
        assert_eq!(says(CanFrame::classic(id, &[1]).unwrap()).as_deref(), Some(message));
        let message = "sent a classic frame, received a CAN FD frame without bit rate switch";
        assert_eq!(
            says(CanFrame::fd(id, &[1, 2], false, false).unwrap()).as_deref(),
            Some(message)
        );
    }
}
