//! A session without a socket, for fuzzing.

use std::time::Duration;

use crate::protocol::{
    Access, Hello, MessageReader, RawRequest, RejectReason, RpcError, Sender, TransmitRecord,
};
use serde_json::Value;

use crate::server::extension::Permission;
use crate::server::job_queue::Requester;
use crate::server::session::{ClientId, Host, Session};

const QUEUE_BYTES: usize = 1 << 20;

/// Result of a session whose input came in pieces.
#[derive(Debug, PartialEq)]
pub struct OfflineSession {
    /// Frames that were passed to the bus.
    pub sent: Vec<TransmitRecord>,
    /// Requests that were passed to the bus.
    pub requests: Vec<RawRequest>,
    /// Bytes for the client.
    pub output: Vec<u8>,
    /// The service would close the connection.
    pub is_ended: bool,
    /// Frames that the session counts as accepted and rejected.
    pub counters: (u64, u64),
}

#[derive(Default)]
struct Recorder {
    sent: Vec<TransmitRecord>,
    requests: Vec<RawRequest>,
}

impl Host for Recorder {
    fn hello(&self) -> Hello {
        Hello::default()
    }

    fn call(
        &mut self,
        _requester: Requester,
        _permission: &Permission,
        request: &RawRequest,
        _arrival: Duration,
    ) -> Option<Result<Value, RpcError>> {
        self.requests.push(request.clone());
        Some(Ok(Value::Null))
    }

    fn transmit(
        &mut self,
        _client: ClientId,
        record: &TransmitRecord,
        _arrival: Duration,
    ) -> Result<(), RejectReason> {
        self.sent.push(*record);
        Ok(())
    }

    fn begin_stream(&mut self) {}
}

impl OfflineSession {
    /// Passes the pieces of a client's bytes to a session.
    pub fn hold<'a>(access: Access, window: u32, pieces: impl Iterator<Item = &'a [u8]>) -> Self {
        let permission = Permission { access, reason: None };
        let mut session =
            Session::new(Requester { client: 1, user: 0 }, permission, QUEUE_BYTES, window);
        let mut host = Recorder::default();
        for piece in pieces {
            session.receive(piece, Duration::ZERO, &mut host);
        }
        session.output.end_batch();
        let counters = (session.counters.frames_accepted, session.counters.frames_rejected);
        let output = session.output.pending().to_vec();
        let Recorder { sent, requests } = host;
        Self { sent, requests, output, is_ended: session.is_ended(), counters }
    }

    /// Reader of the bytes for the client.
    pub fn messages(&self) -> MessageReader {
        let mut reader = MessageReader::new(Sender::Service);
        reader.push(&self.output);
        reader
    }
}
