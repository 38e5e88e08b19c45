//! Queue to a client, frames of the bus and answers in order, and the writer that empties it.

use std::collections::VecDeque;
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use ecan_protocol::can::CanFrame;

use super::config::{BusEvent, BusRates, Conditions, ErrorFrame};
use super::session::ReceiveSettings;

/// Maximum number of queued answer bytes; above it the client is not read.
const MAX_ANSWER_BYTES: usize = 64 * 1024;

#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Outgoing {
    /// A frame of the bus with its end time in nanoseconds of the bus's clock.
    Frame(CanFrame, u64),
    /// Bytes of the protocol, and the client's receive settings after them.
    Answer(Vec<u8>, ReceiveSettings),
    /// An event of the bus with its time.
    Error(ErrorFrame, u64),
    /// Result of the client's frame with this tag: its end time if it was sent.
    Result(u32, Option<u64>),
    /// Number of the client's frames that were accepted and not sent since the last entry, with the
    /// time of the last one.
    Lost(u64, u64),
}

/// Form in which a client receives the losses of its frames, and events of the bus.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) enum Reports {
    /// Lost frames and events, in the form of its protocol.
    #[default]
    Losses,
    /// Events as error frames. A CAN interface has no transmit results.
    Events,
    /// Events as error frames, and the result of each frame.
    EventsAndResults,
}

#[derive(Debug, Default)]
struct State {
    items: VecDeque<Outgoing>,
    frames: usize,
    answer_bytes: usize,
    is_closed: bool,
    /// Since the client last read its flags.
    conditions: Conditions,
    /// The writer waits; nobody else needs to be woken by a frame.
    is_awaited: bool,
}

/// A queue with a limit for frames and one for answer bytes.
#[derive(Debug)]
pub(crate) struct ClientQueue {
    state: Mutex<State>,
    max_frames: usize,
    reports: Reports,
    has_items: Condvar,
    has_room: Condvar,
}

impl ClientQueue {
    pub(crate) fn new(max_frames: usize) -> Self {
        Self::with_reports(max_frames, Reports::default())
    }

    pub(crate) fn with_reports(max_frames: usize, reports: Reports) -> Self {
        let (has_items, has_room) = (Condvar::new(), Condvar::new());
        Self { state: Mutex::default(), max_frames, reports, has_items, has_room }
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Queues a frame; returns false if the queue is full. Does not block.
    pub(crate) fn offer(&self, frame: &CanFrame, time_ns: u64) -> bool {
        self.offer_bounded(Outgoing::Frame(*frame, time_ns))
    }

    /// Queues an event of the bus; returns false if the queue is full.
    pub(crate) fn offer_event(&self, event: BusEvent, error: ErrorFrame, time_ns: u64) -> bool {
        self.lock().conditions.note(event);
        // A client of a protocol with losses has the loss of its frame apart.
        let is_told = self.reports == Reports::Losses && event.is_of_one_frame();
        is_told || self.offer_bounded(Outgoing::Error(error, time_ns))
    }

    /// Queues an event for the loss of several frames if the client receives no report of each;
    /// returns false if the queue is full.
    pub(crate) fn offer_loss_event(&self, time_ns: u64) -> bool {
        let error = ErrorFrame::of(BusEvent::TransmitFailed, None);
        self.reports != Reports::Events || self.offer_bounded(Outgoing::Error(error, time_ns))
    }

    fn offer_bounded(&self, item: Outgoing) -> bool {
        let mut state = self.lock();
        let has_room = state.frames < self.max_frames;
        if has_room {
            state.frames += 1;
            self.push(state, item);
        } else {
            state.conditions.note(BusEvent::ReceiveOverflow);
        }
        has_room
    }

    /// Queues the result of a frame that was sent if the client receives results. The client bounds
    /// their number: it has a limited number of frames without result.
    pub(crate) fn report_sent(&self, tag: u32, sent_ns: u64) {
        if self.reports == Reports::EventsAndResults {
            self.push(self.lock(), Outgoing::Result(tag, Some(sent_ns)));
        }
    }

    /// Queues the loss of an accepted frame. Consecutive losses are one entry, so that their number
    /// is bounded by the other entries. An interface without results receives events only.
    pub(crate) fn report_lost(&self, tag: u32, time_ns: u64) {
        match self.reports {
            Reports::EventsAndResults => self.push(self.lock(), Outgoing::Result(tag, None)),
            Reports::Events => {}
            Reports::Losses => {
                let mut state = self.lock();
                state.conditions.bus_error = true;
                if let Some(Outgoing::Lost(count, last_ns)) = state.items.back_mut() {
                    (*count, *last_ns) = (*count + 1, time_ns);
                } else {
                    self.push(state, Outgoing::Lost(1, time_ns));
                }
            }
        }
    }

    /// What has happened since the last call.
    pub(crate) fn take_conditions(&self) -> Conditions {
        std::mem::take(&mut self.lock().conditions)
    }

    /// Queues an answer. Waits while too many answer bytes are queued; returns false once closed.
    pub(crate) fn answer(&self, text: Vec<u8>, receive_settings: ReceiveSettings) -> bool {
        let state = self.lock();
        let is_full = |state: &mut State| !state.is_closed && state.answer_bytes > MAX_ANSWER_BYTES;
        let waited = self.has_room.wait_while(state, is_full);
        let mut state = waited.unwrap_or_else(PoisonError::into_inner);
        if state.is_closed {
            return false;
        }
        state.answer_bytes += text.len();
        self.push(state, Outgoing::Answer(text, receive_settings));
        true
    }

    fn push(&self, mut state: MutexGuard<'_, State>, item: Outgoing) {
        state.items.push_back(item);
        let is_awaited = state.is_awaited;
        drop(state);
        if is_awaited {
            self.has_items.notify_one();
        }
    }

    /// Waits for the next entry; `None` once closed.
    pub(crate) fn take(&self) -> Option<Outgoing> {
        let mut state = self.lock();
        state.is_awaited = true;
        let is_idle = |state: &mut State| !state.is_closed && state.items.is_empty();
        let waited = self.has_items.wait_while(state, is_idle);
        let mut state = waited.unwrap_or_else(PoisonError::into_inner);
        state.is_awaited = false;
        if state.is_closed { None } else { self.pop(state) }
    }

    /// The next entry, if any.
    pub(crate) fn try_take(&self) -> Option<Outgoing> {
        self.pop(self.lock())
    }

    fn pop(&self, mut state: MutexGuard<'_, State>) -> Option<Outgoing> {
        let item = state.items.pop_front()?;
        match &item {
            Outgoing::Frame(..) | Outgoing::Error(..) => state.frames -= 1,
            Outgoing::Result(..) | Outgoing::Lost(..) => {}
            Outgoing::Answer(text, _) => {
                state.answer_bytes -= text.len();
                drop(state);
                self.has_room.notify_one();
            }
        }
        Some(item)
    }

    /// Ends all waiting; no more entries are returned.
    pub(crate) fn close(&self) {
        self.lock().is_closed = true;
        self.has_items.notify_all();
        self.has_room.notify_all();
    }
}

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
                Outgoing::Error(error, time_ns) => {
                    self.receive_settings.encode_error(error, time_ns, &mut text);
                }
                // An entry of CAN interfaces.
                Outgoing::Result(..) => {}
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
    use std::sync::mpsc::channel;
    use std::time::Duration;

    use ecan_protocol::can::{CanFrame, CanId};
    use ecan_test_support::OnDrop;

    use super::*;
    use crate::bridge::config::BridgeProtocol;

    fn frame() -> CanFrame {
        CanFrame::classic(CanId::standard(1).unwrap(), &[]).unwrap()
    }

    fn nothing() -> ReceiveSettings {
        ReceiveSettings::nothing(BridgeProtocol::Socketcand)
    }

    #[test]
    fn queue_keeps_order_and_bounds_frames() {
        let queue = ClientQueue::new(2);
        assert!(queue.offer(&frame(), 1));
        assert!(queue.answer(vec![b'a'], nothing()));
        assert!(queue.offer(&frame(), 2));
        assert!(!queue.offer(&frame(), 3));
        assert_eq!(queue.take(), Some(Outgoing::Frame(frame(), 1)));
        assert_eq!(queue.take(), Some(Outgoing::Answer(vec![b'a'], nothing())));
        assert!(queue.offer(&frame(), 4));
        assert_eq!(queue.try_take(), Some(Outgoing::Frame(frame(), 2)));
        assert_eq!(queue.try_take(), Some(Outgoing::Frame(frame(), 4)));
        assert_eq!(queue.try_take(), None);
    }

    #[test]
    fn consecutive_losses_are_one_entry() {
        let queue = ClientQueue::new(2);
        assert_eq!(queue.take_conditions(), Conditions::default());
        (1..=1000).for_each(|time_ns| queue.report_lost(0, time_ns));
        assert!(queue.offer(&frame(), 1001));
        queue.report_lost(0, 1002);
        assert_eq!(queue.try_take(), Some(Outgoing::Lost(1000, 1000)));
        assert_eq!(queue.try_take(), Some(Outgoing::Frame(frame(), 1001)));
        assert_eq!(queue.try_take(), Some(Outgoing::Lost(1, 1002)));
        assert_eq!(queue.try_take(), None);
        let lost = Conditions { bus_error: true, ..Conditions::default() };
        assert_eq!(queue.take_conditions(), lost);
        assert_eq!(queue.take_conditions(), Conditions::default());
    }

    #[test]
    fn excess_answers_block_until_taken_or_closed() {
        let queue = &ClientQueue::new(2);
        let (taken, gone) = channel();
        std::thread::scope(|scope| {
            let _end = OnDrop(|| queue.close());
            scope.spawn(move || {
                let answer = || queue.answer(vec![0; 1024], nothing());
                while answer() {
                    taken.send(()).unwrap();
                }
            });
            let timeout = Duration::from_secs(60);
            let fill = MAX_ANSWER_BYTES / 1024 + 1;
            for _ in 0..fill {
                gone.recv_timeout(timeout).unwrap();
            }
            assert!(gone.try_recv().is_err());
            for _ in 0..100 {
                queue.take().unwrap();
                gone.recv_timeout(timeout).unwrap();
            }
            assert!(queue.lock().answer_bytes <= fill * 1024);
            queue.close();
            assert!(gone.recv_timeout(timeout).is_err());
        });
        assert_eq!(queue.take(), None);
    }

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
