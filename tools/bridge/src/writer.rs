//! What goes to a client in one piece.

use std::time::Duration;

use crate::outbox::{ClientQueue, Outgoing};
use crate::rates::BusRates;
use crate::session::ReceiveSettings;

/// Bytes written at a time, about.
const WRITE_BYTES: usize = 16 * 1024;

/// Bytes to write at once.
#[derive(Debug, Default, PartialEq, Eq)]
pub(crate) struct OutputChunk {
    pub(crate) text: Vec<u8>,
    /// To wait before the next one.
    pub(crate) pause: Duration,
}

/// Makes text of what waits for a client.
///
/// What the client wants to hear changes with the answer that says so: no frame stands before it.
/// And such an answer is a piece of its own, since clients compare the whole of what they read with
/// it.
#[derive(Debug)]
pub(crate) struct Writer {
    hearing: ReceiveSettings,
    /// Taken already, but not for the last piece.
    next: Option<Outgoing>,
}

impl Writer {
    pub(crate) fn new(hearing: ReceiveSettings) -> Self {
        Self { hearing, next: None }
    }

    /// Waits for the next piece, which may be empty; none at the end. `bus` gives the rates of the
    /// bus.
    pub(crate) fn next_piece(
        &mut self,
        outbox: &ClientQueue,
        bus: impl FnOnce() -> Option<BusRates>,
    ) -> Option<OutputChunk> {
        let mut next = Some(match self.next.take() {
            Some(item) => item,
            None => outbox.take()?,
        });
        let bus = bus();
        let mut text = Vec::new();
        while let Some(item) = next {
            match item {
                Outgoing::Frame(frame, time_ns) => {
                    self.hearing.encode(&frame, time_ns, bus, &mut text);
                }
                Outgoing::Answer(answer, hearing) if hearing == self.hearing => text.extend(answer),
                Outgoing::Answer(answer, hearing) if text.is_empty() => {
                    let pause = hearing.pause_behind(&self.hearing);
                    self.hearing = hearing;
                    return Some(OutputChunk { text: answer, pause });
                }
                alone @ Outgoing::Answer(..) => {
                    self.next = Some(alone);
                    break;
                }
            }
            next = if text.len() < WRITE_BYTES { outbox.try_take() } else { None };
        }
        Some(OutputChunk { text, pause: Duration::ZERO })
    }
}

#[cfg(test)]
mod tests {
    use ecan_protocol::can::{CanFrame, CanId};

    use super::*;
    use crate::settings::BridgeProtocol;

    fn text(writer: &mut Writer, outbox: &ClientQueue) -> String {
        let piece = writer.next_piece(outbox, || None).unwrap();
        String::from_utf8(piece.text).unwrap()
    }

    #[test]
    fn no_frame_overtakes_the_answer_that_begins_them_or_shares_its_piece() {
        let outbox = ClientQueue::new(10);
        let id = CanId::standard(0x123).unwrap();
        let frame = |data| CanFrame::classic(id, &[data]).unwrap();
        let nothing = ReceiveSettings::nothing(BridgeProtocol::Socketcand);
        let raw = ReceiveSettings::Socketcand { is_raw: true };
        assert!(outbox.offer(&frame(1), 0));
        assert!(outbox.answer(b"< ok >".to_vec(), nothing));
        assert!(outbox.offer(&frame(2), 0));
        assert!(outbox.answer(b"< ok >".to_vec(), raw));
        assert!(outbox.offer(&frame(3), 0));
        assert!(outbox.answer(b"< echo >".to_vec(), raw));
        let writer = &mut Writer::new(nothing);
        assert_eq!(text(writer, &outbox), "< ok >");
        let piece = writer.next_piece(&outbox, || None).unwrap();
        assert_eq!(piece.text, b"< ok >");
        assert!(!piece.pause.is_zero(), "the client has time to read it alone");
        assert_eq!(text(writer, &outbox), "< frame 123 0.000000 03 >< echo >");
        outbox.close();
        assert_eq!(writer.next_piece(&outbox, || None), None);
    }
}
