//! Errors of the client.

use std::io;
use std::path::PathBuf;
use std::sync::Arc;

use crate::protocol::{HeaderError, RecordError, RpcError};
use ecan_protocol::text::Printable;
use thiserror::Error;

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
