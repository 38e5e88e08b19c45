//! Session of a client without its socket: bytes of the client to calls, responses to bytes.

use std::collections::HashMap;
use std::time::Duration;

use serde_json::{Value, json};

use super::config::{Permission, result_value};
use super::job_queue::{CLIENT_LIMIT, ClientId, QueueLimit, Requester, TOTAL_LIMIT, USER_LIMIT};
use super::output_queue::{OutputQueue, rejection};
use crate::protocol::{
    Access, BAD_RECORD, BUSY, EXPIRED, Empty, FrameReport, HELLO_FIRST, HeaderError, Hello,
    HelloParams, INVALID_REQUEST, ImageSubscription, MAX_HELLO_PAYLOAD, MAX_METHOD_PAYLOAD,
    MAX_REQUEST_PAYLOAD, METHOD_NOT_FOUND, METHODS, MessageKind, MessageReader, Method,
    PROTOCOL_VERSION, RawRequest, RejectReason, Response, RpcError, Sender, ServiceStats,
    Subscription, TransmitRecord, TransmitRecords, WRONG_VERSION, clean_name, methods,
};

/// Responses and rejections beyond the client's queue after which its requests wait.
const RESPONSE_BYTES: usize = 64 << 10;

/// Calls of a session to its service.
pub(crate) trait Host {
    /// The response to `hello`, without the access.
    fn hello(&self) -> Hello;

    /// Executes a request that arrived at a time; `None` if its response follows later.
    fn call(
        &mut self,
        requester: Requester,
        permission: &Permission,
        request: &RawRequest,
        arrival: Duration,
    ) -> Option<Result<Value, RpcError>>;

    /// Queues a frame that arrived at a time.
    fn transmit(
        &mut self,
        client: ClientId,
        record: &TransmitRecord,
        arrival: Duration,
    ) -> Result<(), RejectReason>;

    /// A subscription begins: the frames and images before it are not for this client.
    fn begin_stream(&mut self);
}

/// Session of a client.
#[derive(Debug)]
pub(crate) struct Session {
    pub(crate) id: ClientId,
    /// User ID; `UNKNOWN_USER` if the system does not report it.
    pub(crate) user: u32,
    permission: Permission,
    pub(crate) name: String,
    pub(crate) output: OutputQueue,
    pub(crate) frames: Option<Subscription>,
    pub(crate) images: Option<ImageSubscription>,
    pub(crate) counters: SessionCounters,
    reader: MessageReader,
    has_hello: bool,
    /// The client broke the protocol: its connection ends after the output.
    end: Option<SessionEnd>,
    pending_requests: usize,
    window: u32,
    max_queue_bytes: usize,
    /// Own frames without result, by gateway and channel.
    in_flight: HashMap<(u16, u8), u32>,
}

/// Reason for which a service ends a session.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct SessionEnd {
    pub(crate) text: String,
    /// It was passed to the log.
    is_logged: bool,
}

/// Counters of a client's input.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(crate) struct SessionCounters {
    pub(crate) requests: u64,
    pub(crate) requests_rejected: u64,
    pub(crate) requests_expired: u64,
    pub(crate) frames_accepted: u64,
    pub(crate) frames_rejected: u64,
}

impl SessionCounters {
    /// Adds the counters to those of all clients.
    pub(crate) fn add_to(&self, stats: &mut ServiceStats) {
        stats.requests_rejected += self.requests_rejected;
        stats.requests_expired += self.requests_expired;
    }
}

impl Session {
    pub(crate) fn new(
        Requester { client: id, user }: Requester,
        permission: Permission,
        queue_bytes: usize,
        window: u32,
    ) -> Self {
        let mut reader = MessageReader::new(Sender::Client);
        reader.set_max_request(MAX_HELLO_PAYLOAD);
        Self {
            id,
            user,
            permission,
            name: String::new(),
            output: OutputQueue::new(queue_bytes),
            frames: None,
            images: None,
            counters: SessionCounters::default(),
            reader,
            has_hello: false,
            end: None,
            pending_requests: 0,
            window,
            max_queue_bytes: queue_bytes,
            in_flight: HashMap::new(),
        }
    }

    /// Returns whether the connection ends once its output is written.
    pub(crate) fn is_ended(&self) -> bool {
        self.end.is_some()
    }

    /// Reason of the end of the session, once.
    pub(crate) fn take_end(&mut self) -> Option<&str> {
        let end = self.end.as_mut().filter(|end| !end.is_logged)?;
        end.is_logged = true;
        Some(&end.text)
    }

    /// Returns whether the client has introduced itself.
    pub(crate) fn has_hello(&self) -> bool {
        self.has_hello
    }

    pub(crate) fn permission(&self) -> &Permission {
        &self.permission
    }

    pub(crate) fn set_permission(&mut self, permission: Permission) {
        self.permission = permission;
        if self.has_hello {
            self.reader.set_max_request(self.max_request());
        }
    }

    /// Largest request, in bytes: only methods that change something need long ones.
    fn max_request(&self) -> usize {
        match self.permission.access {
            Access::Control => MAX_REQUEST_PAYLOAD,
            Access::Read => MAX_METHOD_PAYLOAD,
        }
    }

    /// Returns whether bytes of the client are read now: not while it reads no responses.
    pub(crate) fn accepts_input(&self) -> bool {
        !self.is_ended() && self.output.len() <= self.max_queue_bytes + RESPONSE_BYTES
    }

    /// Returns whether the session needs the images of the cycle.
    pub(crate) fn needs_images(&self) -> bool {
        self.frames.is_some() || self.images.is_some() || self.frames_pending() > 0
    }

    pub(crate) fn frames_pending(&self) -> u64 {
        self.in_flight.values().map(|count| u64::from(*count)).sum()
    }

    /// Takes bytes of the client that arrived at a time.
    pub(crate) fn receive(&mut self, bytes: &[u8], arrival: Duration, host: &mut impl Host) {
        // Taken out, because its messages borrow it.
        let mut reader = std::mem::replace(&mut self.reader, MessageReader::new(Sender::Client));
        reader.push(bytes);
        while !self.is_ended() {
            match reader.next_message() {
                Ok(Some((MessageKind::Transmit, payload))) if self.has_hello => {
                    self.transmit(payload, arrival, host);
                }
                Ok(Some((MessageKind::Rpc, payload))) => {
                    let had_hello = self.has_hello;
                    self.request(payload, arrival, host);
                    if self.has_hello && !had_hello {
                        reader.set_max_request(self.max_request());
                    }
                }
                Ok(Some(_)) => self.end(HELLO_FIRST, "send hello before frames".into()),
                Ok(None) => break,
                Err(error) => self.reject_header(error),
            }
        }
        self.reader = reader;
        self.output.end_batch();
    }

    fn reject_header(&mut self, error: HeaderError) {
        self.end(INVALID_REQUEST, error.to_string());
    }

    /// Ends the session with an error that belongs to no request.
    pub(crate) fn end(&mut self, code: i32, text: String) {
        self.respond(Value::Null, Err(RpcError::new(code, text.clone())));
        self.end = Some(SessionEnd { text, is_logged: false });
    }

    fn respond(&mut self, id: Value, result: Result<Value, RpcError>) {
        match result.as_ref().map_err(|error| error.code) {
            Err(BUSY) => self.counters.requests_rejected += 1,
            Err(EXPIRED) => self.counters.requests_expired += 1,
            _ => {}
        }
        self.output.push_response(&match result {
            Ok(result) => Response::result(id, result),
            Err(error) => Response::error(id, error),
        });
    }

    /// Sends the response of a request that a worker has executed.
    pub(crate) fn respond_later(&mut self, id: Value, result: Result<Value, RpcError>) {
        self.pending_requests = self.pending_requests.saturating_sub(1);
        self.respond(id, result);
    }

    /// Sends a notification, unless the client reads nothing or has not introduced itself.
    pub(crate) fn notify(&mut self, notification: &Response) {
        if self.has_hello && self.accepts_input() {
            self.output.push_response(notification);
        }
    }

    fn request(&mut self, payload: &[u8], arrival: Duration, host: &mut impl Host) {
        self.counters.requests += 1;
        let request = match RawRequest::parse(payload) {
            Ok(request) => request,
            Err(response) => return self.output.push_response(&response),
        };
        let result = match request.method.as_str() {
            methods::SayHello::NAME => Some(self.hello(&request, host)),
            _ if !self.has_hello => {
                let method = clean_name(&request.method);
                let text = format!("{method} came before hello; send hello first");
                Some(Err(RpcError::new(HELLO_FIRST, text)))
            }
            method => match self.check_access(method).and_then(|()| check_length(&request)) {
                Err(error) => Some(Err(error)),
                Ok(()) => self.call(&request, arrival, host),
            },
        };
        if let Some(result) = result {
            self.respond(request.id, result);
        }
    }

    fn hello(&mut self, request: &RawRequest, host: &impl Host) -> Result<Value, RpcError> {
        let params: HelloParams = request.params()?;
        if params.version != PROTOCOL_VERSION {
            let text = format!(
                "protocol version {} of the client is not supported; the service has version \
                 {PROTOCOL_VERSION}; install the same release of both",
                params.version
            );
            self.end = Some(SessionEnd { text: text.clone(), is_logged: true });
            return Err(RpcError::new(WRONG_VERSION, text));
        }
        self.name = clean_name(&params.client);
        self.has_hello = true;
        let Permission { access, reason } = self.permission.clone();
        result_value(&Hello { access, access_reason: reason, ..host.hello() })
    }

    fn check_access(&self, method: &str) -> Result<(), RpcError> {
        match METHODS.iter().find(|(name, _)| *name == method) {
            Some((_, Access::Control)) => self.permission.need_control(method),
            _ => Ok(()),
        }
    }

    fn call(
        &mut self,
        request: &RawRequest,
        arrival: Duration,
        host: &mut impl Host,
    ) -> Option<Result<Value, RpcError>> {
        let result = match request.method.as_str() {
            methods::SubscribeFrames::NAME => request.params().and_then(|subscription| {
                host.begin_stream();
                self.frames = Some(subscription);
                result_value(&Empty {})
            }),
            methods::SubscribeImages::NAME => request.params().and_then(|subscription| {
                host.begin_stream();
                self.images = Some(subscription);
                result_value(&Empty {})
            }),
            methods::UnsubscribeFrames::NAME => {
                self.frames = None;
                result_value(&Empty {})
            }
            methods::UnsubscribeImages::NAME => {
                self.images = None;
                result_value(&Empty {})
            }
            _ if self.pending_requests >= CLIENT_LIMIT.jobs => Err(limit_error(QueueLimit::Client)),
            _ => {
                let requester = Requester { client: self.id, user: self.user };
                match host.call(requester, &self.permission, request, arrival) {
                    Some(result) => result,
                    None => {
                        self.pending_requests += 1;
                        return None;
                    }
                }
            }
        };
        Some(result)
    }

    fn transmit(&mut self, payload: &[u8], arrival: Duration, host: &mut impl Host) {
        let records: Result<Vec<_>, _> = TransmitRecords::new(payload).collect();
        let records = match records {
            Ok(records) => records,
            Err(error) => {
                let text = format!("transmit batch rejected, none of it is sent: {error}");
                return self.end(BAD_RECORD, text);
            }
        };
        for record in &records {
            let address = (record.gateway, record.channel);
            let in_flight = self.in_flight.get(&address).copied().unwrap_or(0);
            let result = if self.permission.access != Access::Control {
                Err(RejectReason::ReadOnly)
            } else if in_flight >= self.window {
                Err(RejectReason::Window)
            } else {
                host.transmit(self.id, record, arrival)
            };
            match result {
                Ok(()) => {
                    self.counters.frames_accepted += 1;
                    self.in_flight.insert(address, in_flight + 1);
                }
                Err(reason) => {
                    self.counters.frames_rejected += 1;
                    let report = rejection(address, record.tag, record.frame, reason);
                    self.output.push_rejection(&report);
                }
            }
        }
    }

    /// Takes the result of one of its own frames.
    pub(crate) fn deliver_own(&mut self, report: &FrameReport) {
        if let Some(in_flight) = self.in_flight.get_mut(&(report.gateway, report.channel)) {
            *in_flight = in_flight.saturating_sub(1);
        }
        self.output.push_own(report);
    }

    /// Takes a frame of the bus.
    pub(crate) fn deliver(&mut self, report: &FrameReport) {
        let FrameReport { gateway, channel, event, ref frame, .. } = *report;
        if self.frames.as_ref().is_some_and(|filter| filter.selects(gateway, channel, event, frame))
        {
            self.output.push_frame(report);
        }
    }
}

/// Limits the requests of this protocol; a method of the program may need more.
fn check_length(request: &RawRequest) -> Result<(), RpcError> {
    let is_own = METHODS.iter().any(|(name, _)| *name == request.method);
    if request.bytes() <= MAX_METHOD_PAYLOAD || !is_own {
        return Ok(());
    }
    let text = format!(
        "request {} of {} bytes is too long; allowed: at most {MAX_METHOD_PAYLOAD}",
        request.method,
        request.bytes()
    );
    Err(RpcError::new(INVALID_REQUEST, text))
}

pub(crate) fn no_such_method(method: &str) -> RpcError {
    let method = clean_name(method);
    RpcError::new(METHOD_NOT_FOUND, format!("method {method} does not exist in this service"))
}

/// Error of a request for which a queue has no room.
pub(crate) fn limit_error(limit: QueueLimit) -> RpcError {
    let (of, name, limit) = match limit {
        QueueLimit::Client => ("this client", "client", CLIENT_LIMIT),
        QueueLimit::User => ("this user", "user", USER_LIMIT),
        QueueLimit::Total => ("all clients", "service", TOTAL_LIMIT),
    };
    let text = format!(
        "requests of {of} are pending: the limit is {} requests or {} KiB; wait for a response",
        limit.jobs,
        limit.bytes >> 10
    );
    let data = json!({ "limit": name, "requests": limit.jobs, "bytes": limit.bytes });
    RpcError { data, ..RpcError::new(BUSY, text) }
}

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
