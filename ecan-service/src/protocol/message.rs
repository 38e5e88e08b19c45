//! Messages: a header of 8 bytes, then the payload.

use thiserror::Error;

/// Bytes of the header.
pub const HEADER_BYTES: usize = 8;
/// Largest payload from the service, in bytes.
pub const MAX_SERVICE_PAYLOAD: usize = 1 << 20;
/// Largest request of a client with control, in bytes.
pub const MAX_REQUEST_PAYLOAD: usize = 1 << 20;
/// Largest request of a client that only reads, and of every method of this protocol, in bytes. Methods
/// of a program may need more.
pub const MAX_METHOD_PAYLOAD: usize = 64 << 10;
/// Largest request before the response to `hello`, in bytes.
pub const MAX_HELLO_PAYLOAD: usize = 4 << 10;
/// Largest batch of transmit records, in bytes.
pub const MAX_TRANSMIT_PAYLOAD: usize = 64 << 10;

/// Type of a message.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[repr(u8)]
pub enum MessageKind {
    /// A JSON-RPC 2.0 message in UTF-8, in both directions.
    Rpc = 1,
    /// Frame records, from the service.
    Frames = 2,
    /// Transmit records, to the service.
    Transmit = 3,
    /// A PDO image, from the service.
    Image = 4,
}

impl MessageKind {
    const fn from_raw(raw: u8) -> Option<Self> {
        match raw {
            1 => Some(Self::Rpc),
            2 => Some(Self::Frames),
            3 => Some(Self::Transmit),
            4 => Some(Self::Image),
            _ => None,
        }
    }
}

/// Sender of the messages of one direction.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Sender {
    /// The service.
    Service,
    /// A client.
    Client,
}

impl Sender {
    /// Largest payload, in bytes.
    pub const fn max_payload(self, kind: MessageKind) -> usize {
        match (self, kind) {
            (Self::Service, _) => MAX_SERVICE_PAYLOAD,
            (Self::Client, MessageKind::Transmit) => MAX_TRANSMIT_PAYLOAD,
            (Self::Client, _) => MAX_REQUEST_PAYLOAD,
        }
    }

    const fn sends(self, kind: MessageKind) -> bool {
        matches!(
            (self, kind),
            (_, MessageKind::Rpc)
                | (Self::Service, MessageKind::Frames | MessageKind::Image)
                | (Self::Client, MessageKind::Transmit)
        )
    }
}

/// Fault of a header. The bytes after it cannot be read: close the connection.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
pub enum HeaderError {
    /// The payload is too long.
    #[error("message of {bytes} bytes is too long; allowed: at most {max} bytes of payload")]
    TooLong {
        /// Length in the header.
        bytes: u32,
        /// Largest length of this type in this direction.
        max: usize,
    },
    /// No such type, or one of the other direction.
    #[error(
        "message type {0} is not allowed in this direction; allowed: 1 and 3 to the service, 1, 2 and 4 from it"
    )]
    Kind(u8),
    /// A reserved byte is not zero.
    #[error("reserved bytes of the message header are {0:02x?}; allowed: 0")]
    Reserved([u8; 3]),
}

/// Returns the header of a message. A payload beyond the limit of its direction is the caller's fault.
pub const fn header(kind: MessageKind, payload_bytes: usize) -> [u8; HEADER_BYTES] {
    let [a, b, c, d] = (payload_bytes as u32).to_le_bytes();
    [a, b, c, d, kind as u8, 0, 0, 0]
}

/// Reads a header: the type, and the length of the payload.
///
/// # Errors
/// [`HeaderError`].
pub fn read_header(
    header: [u8; HEADER_BYTES],
    sender: Sender,
) -> Result<(MessageKind, usize), HeaderError> {
    let [a, b, c, d, kind, reserved @ ..] = header;
    let bytes = u32::from_le_bytes([a, b, c, d]);
    let known = MessageKind::from_raw(kind).filter(|kind| sender.sends(*kind));
    let kind = known.ok_or(HeaderError::Kind(kind))?;
    if reserved != [0; 3] {
        return Err(HeaderError::Reserved(reserved));
    }
    let max = sender.max_payload(kind);
    match usize::try_from(bytes) {
        Ok(length) if length <= max => Ok((kind, length)),
        _ => Err(HeaderError::TooLong { bytes, max }),
    }
}

/// Bytes of memory that a [`MessageReader`] keeps.
const KEPT_BYTES: usize = 128 << 10;

/// Cuts a byte stream into messages.
///
/// ```
/// use ecan_service::protocol::{MessageKind, MessageReader, Sender, header};
///
/// let mut reader = MessageReader::new(Sender::Client);
/// reader.push(&header(MessageKind::Rpc, 2));
/// assert_eq!(reader.next_message()?, None);
/// reader.push(b"{}");
/// assert_eq!(reader.next_message()?, Some((MessageKind::Rpc, &b"{}"[..])));
/// # Ok::<(), ecan_service::protocol::HeaderError>(())
/// ```
#[derive(Debug)]
pub struct MessageReader {
    sender: Sender,
    /// Largest request, in bytes.
    max_request: usize,
    bytes: Vec<u8>,
    /// Bytes of the messages that were returned.
    used: usize,
}

impl MessageReader {
    /// Creates a reader of what `sender` writes.
    pub const fn new(sender: Sender) -> Self {
        let max_request = sender.max_payload(MessageKind::Rpc);
        Self { sender, max_request, bytes: Vec::new(), used: 0 }
    }

    /// Sets a lower limit for JSON-RPC messages, in bytes of their payload.
    pub const fn set_max_request(&mut self, bytes: usize) {
        self.max_request = bytes;
    }

    /// Adds bytes of the stream. The caller limits them: push, then take every message.
    pub fn push(&mut self, bytes: &[u8]) {
        self.bytes.drain(..self.used);
        self.used = 0;
        if self.bytes.is_empty() {
            // Memory of a long message.
            self.bytes.shrink_to(KEPT_BYTES);
        }
        self.bytes.extend_from_slice(bytes);
    }

    /// Takes the next complete message; `None` if bytes are missing.
    ///
    /// # Errors
    /// [`HeaderError`], again in each later call.
    pub fn next_message(&mut self) -> Result<Option<(MessageKind, &[u8])>, HeaderError> {
        let rest = self.bytes.get(self.used..).unwrap_or_default();
        let Some((head, rest)) = rest.split_first_chunk::<HEADER_BYTES>() else { return Ok(None) };
        let (kind, length) = read_header(*head, self.sender)?;
        if kind == MessageKind::Rpc && length > self.max_request {
            return Err(HeaderError::TooLong { bytes: length as u32, max: self.max_request });
        }
        let Some(payload) = rest.get(..length) else { return Ok(None) };
        self.used += HEADER_BYTES + length;
        Ok(Some((kind, payload)))
    }

    /// Bytes of an incomplete message.
    pub const fn pending_bytes(&self) -> usize {
        self.bytes.len() - self.used
    }
}
