//! Session of a client without its socket: bytes of the client to calls, responses to bytes.

use std::collections::HashMap;

use ecan_service_protocol::{
    Access, BAD_RECORD, BUSY, Empty, FrameReport, HELLO_FIRST, HeaderError, Hello, HelloParams,
    ImageSubscription, METHOD_NOT_FOUND, METHODS, MessageKind, MessageReader, Method,
    PROTOCOL_VERSION, RejectReason, Request, Response, RpcError, Sender, Subscription,
    TransmitRecord, TransmitRecords, WRONG_VERSION, methods,
};
use serde_json::Value;

use crate::extension::{Permission, parse_params, result_value};
use crate::output_queue::{OutputQueue, rejection};

/// Requests of one client that may be pending in workers.
const MAX_PENDING_REQUESTS: usize = 16;
/// Bytes of a name that are kept.
const MAX_NAME_BYTES: usize = 64;
/// Responses and rejections beyond the client's queue after which its requests wait.
const RESPONSE_BYTES: usize = 64 << 10;

/// Number of a client, from 1.
pub(crate) type ClientId = u64;

/// Calls of a session to its service.
pub(crate) trait Host {
    /// The response to `hello`, without the access.
    fn hello(&self) -> Hello;

    /// Executes a request; `None` if its response follows later.
    fn call(
        &mut self,
        client: ClientId,
        permission: &Permission,
        request: &Request,
    ) -> Option<Result<Value, RpcError>>;

    /// Queues a frame.
    fn transmit(&mut self, client: ClientId, record: &TransmitRecord) -> Result<(), RejectReason>;

    /// A subscription begins: the frames and images before it are not for this client.
    fn begin_stream(&mut self);
}

/// Session of a client.
#[derive(Debug)]
pub(crate) struct Session {
    pub(crate) id: ClientId,
    pub(crate) permission: Permission,
    pub(crate) name: String,
    pub(crate) output: OutputQueue,
    pub(crate) frames: Option<Subscription>,
    pub(crate) images: Option<ImageSubscription>,
    pub(crate) counters: SessionCounters,
    reader: MessageReader,
    has_hello: bool,
    /// The client broke the protocol: its connection ends after the output.
    is_ended: bool,
    pending_requests: usize,
    window: u32,
    max_queue_bytes: usize,
    /// Own frames without result, by gateway and channel.
    in_flight: HashMap<(u16, u8), u32>,
}

/// Counters of a client's input.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(crate) struct SessionCounters {
    pub(crate) requests: u64,
    pub(crate) frames_accepted: u64,
    pub(crate) frames_rejected: u64,
}

impl Session {
    pub(crate) fn new(
        id: ClientId,
        permission: Permission,
        queue_bytes: usize,
        window: u32,
    ) -> Self {
        Self {
            id,
            permission,
            name: String::new(),
            output: OutputQueue::new(queue_bytes),
            frames: None,
            images: None,
            counters: SessionCounters::default(),
            reader: MessageReader::new(Sender::Client),
            has_hello: false,
            is_ended: false,
            pending_requests: 0,
            window,
            max_queue_bytes: queue_bytes,
            in_flight: HashMap::new(),
        }
    }

    /// Returns whether the connection ends once its output is written.
    pub(crate) fn is_ended(&self) -> bool {
        self.is_ended
    }

    /// Returns whether bytes of the client are read now: not while it reads no responses.
    pub(crate) fn accepts_input(&self) -> bool {
        !self.is_ended && self.output.len() <= self.max_queue_bytes + RESPONSE_BYTES
    }

    /// Returns whether the session needs the images of the cycle.
    pub(crate) fn needs_images(&self) -> bool {
        self.frames.is_some() || self.images.is_some() || self.frames_pending() > 0
    }

    pub(crate) fn frames_pending(&self) -> u64 {
        self.in_flight.values().map(|count| u64::from(*count)).sum()
    }

    /// Takes bytes of the client.
    pub(crate) fn receive(&mut self, bytes: &[u8], host: &mut impl Host) {
        // Taken out, because its messages borrow it.
        let mut reader = std::mem::replace(&mut self.reader, MessageReader::new(Sender::Client));
        reader.push(bytes);
        while !self.is_ended {
            match reader.next_message() {
                Ok(Some((MessageKind::Transmit, payload))) if self.has_hello => {
                    self.transmit(payload, host);
                }
                Ok(Some((MessageKind::Rpc, payload))) => self.request(payload, host),
                Ok(Some(_)) => self.end(HELLO_FIRST, "send hello before frames".into()),
                Ok(None) => break,
                Err(error) => self.reject_header(error),
            }
        }
        self.reader = reader;
        self.output.end_batch();
    }

    fn reject_header(&mut self, error: HeaderError) {
        self.end(ecan_service_protocol::INVALID_REQUEST, error.to_string());
    }

    /// Ends the session with an error that belongs to no request.
    fn end(&mut self, code: i32, text: String) {
        tracing::warn!("client {} ({}): disconnected: {text}", self.id, self.name);
        self.respond(Value::Null, Err(RpcError::new(code, text)));
        self.is_ended = true;
    }

    fn respond(&mut self, id: Value, result: Result<Value, RpcError>) {
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

    fn request(&mut self, payload: &[u8], host: &mut impl Host) {
        self.counters.requests += 1;
        let request = match Request::parse(payload) {
            Ok(request) => request,
            Err(response) => return self.output.push_response(&response),
        };
        let result = match request.method.as_str() {
            methods::SayHello::NAME => Some(self.hello(&request, host)),
            _ if !self.has_hello => {
                let text = format!("{} came before hello; send hello first", request.method);
                Some(Err(RpcError::new(HELLO_FIRST, text)))
            }
            method => match self.check_access(method) {
                Err(error) => Some(Err(error)),
                Ok(()) => self.call(&request, host),
            },
        };
        if let Some(result) = result {
            self.respond(request.id, result);
        }
    }

    fn hello(&mut self, request: &Request, host: &impl Host) -> Result<Value, RpcError> {
        let params: HelloParams = parameters(request)?;
        if params.version != PROTOCOL_VERSION {
            self.is_ended = true;
            let text = format!(
                "protocol version {} of the client is not supported; the service has version \
                 {PROTOCOL_VERSION}; install the same release of both",
                params.version
            );
            return Err(RpcError::new(WRONG_VERSION, text));
        }
        let end = params.client.floor_char_boundary(MAX_NAME_BYTES);
        self.name = params.client.get(..end).unwrap_or_default().into();
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

    fn call(&mut self, request: &Request, host: &mut impl Host) -> Option<Result<Value, RpcError>> {
        Some(match request.method.as_str() {
            methods::SubscribeFrames::NAME => parameters(request).and_then(|subscription| {
                host.begin_stream();
                self.frames = Some(subscription);
                result_value(&Empty {})
            }),
            methods::SubscribeImages::NAME => parameters(request).and_then(|subscription| {
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
            _ if self.pending_requests >= MAX_PENDING_REQUESTS => {
                let text = format!(
                    "{MAX_PENDING_REQUESTS} requests of this client are pending; wait for a response"
                );
                Err(RpcError::new(BUSY, text))
            }
            _ => match host.call(self.id, &self.permission, request) {
                Some(result) => result,
                None => {
                    self.pending_requests += 1;
                    return None;
                }
            },
        })
    }

    fn transmit(&mut self, payload: &[u8], host: &mut impl Host) {
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
                host.transmit(self.id, record)
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
        if self.frames.as_ref().is_some_and(|it| it.selects(gateway, channel, event, frame)) {
            self.output.push_frame(report);
        }
    }
}

/// Parameters of a request.
pub(crate) fn parameters<P: serde::de::DeserializeOwned>(request: &Request) -> Result<P, RpcError> {
    parse_params(&request.method, &request.params)
}

pub(crate) fn no_such_method(method: &str) -> RpcError {
    RpcError::new(METHOD_NOT_FOUND, format!("method {method} does not exist in this service"))
}
