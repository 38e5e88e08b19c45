//! Output to a client.

use std::time::Duration;

use super::config::BusRates;
use crate::bridge::client_queue::{ClientQueue, Outgoing};
use crate::bridge::session::ReceiveSettings;

/// Approximate number of bytes written at a time.
const WRITE_BYTES: usize = 16 * 1024;
/// Number of losses of a chunk, so that its size is independent of the number that were lost.
const WRITE_LOSSES: u64 = 512;

#[derive(Debug, Default, PartialEq, Eq)]
pub(crate) struct OutputChunk {
    pub(crate) text: Vec<u8>,
    pub(crate) pause: Duration,
}

/// Encodes the queue of a client.
///
/// The receive settings change with the answer that confirms them: no frame precedes it. Such an
/// answer is a separate chunk, because clients compare all that they read with it.
#[derive(Debug)]
pub(crate) struct Writer {
    receive_settings: ReceiveSettings,
    /// Entry taken from the queue that starts the next chunk.
    next: Option<Outgoing>,
}

impl Writer {
    pub(crate) fn new(receive_settings: ReceiveSettings) -> Self {
        Self { receive_settings, next: None }
    }

    /// Waits for the next chunk, which may be empty; `None` at the end. `bus` returns the rates of
    /// the bus.
    pub(crate) fn next_chunk(
        &mut self,
        queue: &ClientQueue,
        bus: impl FnOnce() -> Option<BusRates>,
    ) -> Option<OutputChunk> {
        let mut next = Some(match self.next.take() {
            Some(item) => item,
            None => queue.take()?,
        });
        let bus = bus();
        let mut text = Vec::new();
        while let Some(item) = next {
            match item {
                Outgoing::Frame(frame, time_ns) => {
                    self.receive_settings.encode(&frame, time_ns, bus, &mut text);
                }
                Outgoing::Lost(count, time_ns) => {
                    let written = count.min(WRITE_LOSSES);
                    self.receive_settings.encode_losses(written, time_ns, &mut text);
                    if written < count {
                        self.next = Some(Outgoing::Lost(count - written, time_ns));
                        break;
                    }
                }
                // Entries of CAN interfaces.
                Outgoing::Error(..) | Outgoing::Result(..) => {}
                Outgoing::Answer(answer, receive_settings)
                    if receive_settings == self.receive_settings =>
                {
                    text.extend(answer)
                }
                Outgoing::Answer(answer, receive_settings) if text.is_empty() => {
                    let pause = receive_settings.pause_after(&self.receive_settings);
                    self.receive_settings = receive_settings;
                    return Some(OutputChunk { text: answer, pause });
                }
                alone @ Outgoing::Answer(..) => {
                    self.next = Some(alone);
                    break;
                }
            }
            next = if text.len() < WRITE_BYTES { queue.try_take() } else { None };
        }
        Some(OutputChunk { text, pause: Duration::ZERO })
    }
}

#[cfg(test)]
mod tests {
    use ecan_protocol::can::{CanFrame, CanId};

    use super::*;
    use crate::bridge::config::BridgeProtocol;

    fn text(writer: &mut Writer, queue: &ClientQueue) -> String {
        let chunk = writer.next_chunk(queue, || None).unwrap();
        String::from_utf8(chunk.text).unwrap()
    }

    #[test]
    fn frame_follows_answer_in_separate_chunk() {
        let queue = ClientQueue::new(10);
        let id = CanId::standard(0x123).unwrap();
        let frame = |data| CanFrame::classic(id, &[data]).unwrap();
        let nothing = ReceiveSettings::nothing(BridgeProtocol::Socketcand);
        let raw = ReceiveSettings::Socketcand { is_raw: true };
        assert!(queue.offer(&frame(1), 0));
        assert!(queue.answer(b"< ok >".to_vec(), nothing));
        assert!(queue.offer(&frame(2), 0));
        assert!(queue.answer(b"< ok >".to_vec(), raw));
        assert!(queue.offer(&frame(3), 0));
        assert!(queue.answer(b"< echo >".to_vec(), raw));
        let writer = &mut Writer::new(nothing);
        assert_eq!(text(writer, &queue), "< ok >");
        let chunk = writer.next_chunk(&queue, || None).unwrap();
        assert_eq!(chunk.text, b"< ok >");
        assert!(!chunk.pause.is_zero(), "the client has time to read it alone");
        assert_eq!(text(writer, &queue), "< frame 123 0.000000 03 >< echo >");
        queue.close();
        assert_eq!(writer.next_chunk(&queue, || None), None);
    }

    #[test]
    fn many_losses_are_written_in_bounded_chunks() {
        const LOST: u64 = 100_000;
        for (protocol, loss) in [
            (BridgeProtocol::Slcan, "\x07"),
            (BridgeProtocol::Socketcand, "< error 001 1.500000 >"),
        ] {
            let queue = ClientQueue::new(10);
            let settings = ReceiveSettings::nothing(protocol);
            (0..LOST).for_each(|_| queue.report_lost(0, 1_500_000_000));
            assert!(queue.answer(b"z".to_vec(), settings));
            let writer = &mut Writer::new(settings);
            let (mut output, mut largest) = (String::new(), 0);
            while !output.ends_with('z') {
                let chunk = text(writer, &queue);
                largest = largest.max(chunk.len());
                output += &chunk;
            }
            assert!(largest < 2 * WRITE_BYTES, "{protocol:?}: {largest} bytes in a chunk");
            assert!(
                output == loss.repeat(LOST as usize) + "z",
                "{protocol:?}: every loss, in order"
            );
        }
    }
}
