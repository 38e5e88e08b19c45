//! What a client received, and its errors.

use std::collections::{HashMap, VecDeque};
use std::io;
use std::path::PathBuf;
use std::sync::Arc;

use ecan_protocol::image::PdoProfile;
use ecan_protocol::mapping::Direction;
use ecan_protocol::text::Printable;
use serde_json::Value;
use thiserror::Error;

use crate::protocol::{
    FrameRecord, FrameRecords, FrameReport, GatewaysChanged, HeaderError, ImageMessage,
    MessageKind, MessageReader, RecordError, Response, RpcError, Sender,
};

/// Approximate bytes of the queued events, above which new frames and images are lost.
const MAX_QUEUED_BYTES: usize = 16 << 20;

#[derive(Debug)]
pub(crate) struct Inbox {
    reader: MessageReader,
    events: VecDeque<Event>,
    queued_bytes: usize,
    /// Requests whose response is pending, or has arrived.
    responses: HashMap<u64, Option<Result<Value, RpcError>>>,
    /// Own frames without result, by gateway and channel.
    in_flight: HashMap<(u16, u8), u32>,
}

/// Memory of an event in the queue.
fn bytes_of(event: &Event) -> usize {
    let image = if let Event::Image(image) = event { image.image.len() } else { 0 };
    size_of::<Event>() + image
}

impl Inbox {
    pub(crate) fn new() -> Self {
        Self {
            reader: MessageReader::new(Sender::Service),
            events: VecDeque::new(),
            queued_bytes: 0,
            responses: HashMap::new(),
            in_flight: HashMap::new(),
        }
    }

    pub(crate) fn expect_response(&mut self, id: u64) {
        self.responses.insert(id, None);
    }

    pub(crate) fn forget_response(&mut self, id: u64) {
        self.responses.remove(&id);
    }

    pub(crate) fn take_response(&mut self, id: u64) -> Option<Result<Value, RpcError>> {
        let response = self.responses.get_mut(&id)?.take()?;
        self.responses.remove(&id);
        Some(response)
    }

    pub(crate) fn take_event(&mut self) -> Option<Event> {
        let event = self.events.pop_front()?;
        self.queued_bytes -= bytes_of(&event);
        Some(event)
    }

    pub(crate) fn has_room(&self) -> bool {
        self.queued_bytes < MAX_QUEUED_BYTES
    }

    /// Own frames of a channel without result.
    pub(crate) fn in_flight(&mut self, gateway: u16, channel: u8) -> &mut u32 {
        self.in_flight.entry((gateway, channel)).or_default()
    }

    /// Adds bytes of the connection.
    pub(crate) fn receive(&mut self, bytes: &[u8]) -> Result<(), ClientError> {
        // Taken out, because its messages borrow it.
        let mut reader = std::mem::replace(&mut self.reader, MessageReader::new(Sender::Service));
        reader.push(bytes);
        let mut take_all = || {
            while let Some((kind, payload)) = reader.next_message()? {
                self.take_message(kind, payload)?;
            }
            Ok(())
        };
        let result = take_all();
        self.reader = reader;
        result
    }

    fn take_message(&mut self, kind: MessageKind, payload: &[u8]) -> Result<(), ClientError> {
        match kind {
            MessageKind::Rpc => self.take_rpc(serde_json::from_slice(payload)?)?,
            MessageKind::Frames => {
                for record in FrameRecords::new(payload) {
                    match record? {
                        FrameRecord::Frame(report) => self.take_frame(report),
                        FrameRecord::Lost { frames, .. } => {
                            self.add_lost(Lost { frames: frames.into(), ..Lost::default() });
                        }
                    }
                }
            }
            MessageKind::Image => {
                let message = ImageMessage::decode(payload)?;
                if message.lost > 0 {
                    self.add_lost(Lost { images: message.lost.into(), ..Lost::default() });
                }
                let lost = Lost { images_in_client: 1, ..Lost::default() };
                self.push_or_lose(Event::Image(message.into()), lost);
            }
            // The reader accepts no message of the other direction.
            MessageKind::Transmit => {}
        }
        Ok(())
    }

    fn take_frame(&mut self, report: FrameReport) {
        if report.tag != 0 && report.event.ends_transmission() {
            let in_flight = self.in_flight(report.gateway, report.channel);
            *in_flight = in_flight.saturating_sub(1);
        }
        let lost = Lost { frames_in_client: 1, ..Lost::default() };
        self.push_or_lose(Event::Frame(report), lost);
    }

    fn take_rpc(&mut self, response: Response) -> Result<(), ClientError> {
        let Response { id, result, error, method, params, .. } = response;
        match (id, method) {
            (None, Some(method)) => {
                let event = if method == "gateways" {
                    Event::Gateways(serde_json::from_value::<GatewaysChanged>(params)?)
                } else {
                    Event::Notification { method, params }
                };
                self.push(event);
                Ok(())
            }
            (Some(id), _) => {
                let slot = id.as_u64().and_then(|id| self.responses.get_mut(&id));
                match (slot, error) {
                    (Some(slot), Some(error)) => *slot = Some(Err(error)),
                    (Some(slot), None) => *slot = Some(Ok(result.unwrap_or_default())),
                    // An error without a request ends the connection.
                    (None, Some(error)) if id.is_null() => {
                        return Err(ClientError::Rpc(Box::new(error)));
                    }
                    // Of a request that timed out.
                    (None, _) => {}
                }
                Ok(())
            }
            (None, None) => Err(ClientError::Protocol("response without id".into())),
        }
    }

    fn push(&mut self, event: Event) {
        self.queued_bytes += bytes_of(&event);
        self.events.push_back(event);
    }

    fn push_or_lose(&mut self, event: Event, lost: Lost) {
        if self.has_room() { self.push(event) } else { self.add_lost(lost) }
    }

    /// Adds to the losses at the end of the queue.
    fn add_lost(&mut self, lost: Lost) {
        match self.events.back_mut() {
            Some(Event::Lost(last)) => last.add(lost),
            _ => self.push(Event::Lost(lost)),
        }
    }
}

/// Event from the service.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum Event {
    /// A frame: of the subscription, or a result of this client's own frames.
    Frame(FrameReport),
    /// A PDO image of the subscription.
    Image(ReceivedImage),
    /// Data that this client lost at this point: it read too slowly.
    Lost(Lost),
    /// The bus was configured again.
    Gateways(GatewaysChanged),
    /// Another notification.
    Notification {
        /// Its name.
        method: String,
        /// Its parameters.
        params: Value,
    },
}

/// Numbers of lost frames and images.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Lost {
    /// Frames that the service could not deliver.
    pub frames: u64,
    /// Images that the service could not deliver.
    pub images: u64,
    /// Frames that found the buffer of this client full, during a request.
    pub frames_in_client: u64,
    /// Images that found the buffer of this client full, during a request.
    pub images_in_client: u64,
}

impl Lost {
    pub(crate) fn add(&mut self, other: Self) {
        self.frames += other.frames;
        self.images += other.images;
        self.frames_in_client += other.frames_in_client;
        self.images_in_client += other.images_in_client;
    }
}

/// A PDO image.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ReceivedImage {
    /// Start of the cycle, as in a frame.
    pub time_ns: u64,
    /// Number of the cycle.
    pub cycle: u64,
    /// Index of the gateway.
    pub gateway: u16,
    /// Direction.
    pub direction: Direction,
    /// Profile of the image.
    pub profile: PdoProfile,
    /// The image.
    pub image: Box<[u8]>,
}

impl From<ImageMessage<'_>> for ReceivedImage {
    fn from(message: ImageMessage<'_>) -> Self {
        let ImageMessage { time_ns, cycle, gateway, direction, profile, image, .. } = message;
        Self { time_ns, cycle, gateway, direction, profile, image: image.into() }
    }
}

/// Error of a connection or a request.
#[derive(Debug, Clone, Error)]
#[non_exhaustive]
pub enum ClientError {
    /// The socket cannot be connected: not found, not listening, or not permitted.
    #[error("cannot connect to {}: {source}", Printable(path.display()))]
    Connect {
        /// Path of the socket.
        path: PathBuf,
        /// Cause.
        source: Arc<io::Error>,
    },
    /// The connection failed.
    #[error("connection to the service failed: {0}")]
    Io(Arc<io::Error>),
    /// The service closed the connection.
    #[error("the service closed the connection")]
    Closed,
    /// The service sent bytes that are not of this protocol.
    #[error("invalid bytes from the service: {}", Printable(.0))]
    Protocol(String),
    /// The service did not respond in time.
    #[error("the service did not respond to {method} within {timeout_ms} ms")]
    Timeout {
        /// The method.
        method: String,
        /// Time waited, in milliseconds.
        timeout_ms: u64,
    },
    /// The service rejected the request, or the bus call failed.
    #[error(transparent)]
    Rpc(Box<RpcError>),
}

impl ClientError {
    /// The error of the service, if this is one.
    pub fn rpc(&self) -> Option<&RpcError> {
        match self {
            Self::Rpc(error) => Some(error),
            _ => None,
        }
    }

    /// Returns whether there is no connection, or it has ended: another one may follow.
    pub fn is_disconnection(&self) -> bool {
        matches!(self, Self::Closed | Self::Io(_) | Self::Connect { .. })
    }
}

impl From<io::Error> for ClientError {
    fn from(error: io::Error) -> Self {
        Self::Io(Arc::new(error))
    }
}

impl From<rustix::io::Errno> for ClientError {
    fn from(error: rustix::io::Errno) -> Self {
        io::Error::from(error).into()
    }
}

impl From<HeaderError> for ClientError {
    fn from(error: HeaderError) -> Self {
        Self::Protocol(error.to_string())
    }
}

impl From<RecordError> for ClientError {
    fn from(error: RecordError) -> Self {
        Self::Protocol(error.to_string())
    }
}

impl From<serde_json::Error> for ClientError {
    fn from(error: serde_json::Error) -> Self {
        Self::Protocol(error.to_string())
    }
}

/// Error of a frame that was not sent.
#[derive(Debug, Clone, Error)]
#[non_exhaustive]
pub enum SendError {
    /// The window is full of frames without result. As `ENOBUFS`: read events, then retry.
    #[error(
        "gateway {gateway} channel {channel}: {window} frames have no result yet; retry after an event"
    )]
    WindowFull {
        /// Index of the gateway.
        gateway: u16,
        /// Channel.
        channel: u8,
        /// Frames that the service allows.
        window: u32,
    },
    /// The client may only read.
    #[error("cannot send a frame: {}", Printable(reason))]
    ReadOnly {
        /// Reason of the service.
        reason: String,
    },
    /// The connection failed.
    #[error(transparent)]
    Client(#[from] ClientError),
}

#[cfg(test)]
mod tests {
    use ecan_protocol::can::{CanFrame, CanId};

    use super::*;
    use crate::protocol::{FrameEvent, header};

    fn batch(records: &[FrameRecord]) -> Vec<u8> {
        let mut payload = Vec::new();
        records.iter().for_each(|record| record.encode(&mut payload));
        let mut message = header(MessageKind::Frames, payload.len()).to_vec();
        message.append(&mut payload);
        message
    }

    fn frame(tag: u32, event: FrameEvent) -> FrameRecord {
        let frame = CanFrame::classic(CanId::standard(1).unwrap(), &[]).unwrap();
        FrameRecord::Frame(FrameReport { time_ns: 0, gateway: 0, channel: 0, tag, event, frame })
    }

    #[test]
    fn full_inbox_counts_what_it_loses_in_order() {
        let mut inbox = Inbox::new();
        let many = batch(&[frame(0, FrameEvent::Received); 1000]);
        let mut received = 0;
        while inbox.has_room() {
            inbox.receive(&many).unwrap();
            received += 1000;
        }
        inbox.receive(&batch(&[FrameRecord::Lost { time_ns: 0, frames: 7 }])).unwrap();
        inbox.receive(&many).unwrap();
        let mut kept = 0;
        while let Some(Event::Frame(_)) = inbox.events.front() {
            inbox.take_event();
            kept += 1;
        }
        let lost = Lost { frames: 7, frames_in_client: received + 1000 - kept, ..Lost::default() };
        assert_eq!(inbox.take_event(), Some(Event::Lost(lost)));
        assert_eq!((inbox.take_event(), inbox.queued_bytes), (None, 0));
        assert!(inbox.has_room());
    }

    #[test]
    fn own_results_free_the_window_even_if_the_event_is_lost() {
        let mut inbox = Inbox::new();
        inbox.queued_bytes = MAX_QUEUED_BYTES;
        *inbox.in_flight(0, 0) = 2;
        let echo = [frame(9, FrameEvent::Transmitted), frame(0, FrameEvent::Transmitted)];
        inbox.receive(&batch(&echo)).unwrap();
        assert_eq!(*inbox.in_flight(0, 0), 1);
    }
}
