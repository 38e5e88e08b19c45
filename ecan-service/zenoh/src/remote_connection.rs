//! One connection of a local client to a published service.

use std::collections::{BTreeMap, VecDeque};
use std::io::{ErrorKind, Read as _};
use std::os::unix::net::UnixStream;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::thread;
use std::time::{Duration, Instant};

use ecan_service::client::{
    BUSY, DEFAULT_MAX_AGE_MS, EXPIRED, FrameEvent, FrameRecord, FrameRecords, FrameReport,
    GatewaysChanged, Hello, METHOD_NOT_FOUND, MessageKind, MessageReader, Method as _,
    NOT_AVAILABLE, NOT_PERMITTED, RawRequest, RejectReason, Response, RpcError, Sender,
    TransmitRecord, TransmitRecords, methods,
};
use serde_json::{Value, json};
use zenoh::pubsub::Subscriber;
use zenoh::query::Reply;
use zenoh::sample::{Sample, SampleKind};
use zenoh::{Session, Wait as _};

use crate::connection_output::ConnectionOutput;
use crate::frame_account::{Accounts, BatchHead, OwnFrames, SubscriptionInfo};
use crate::frame_batches::LEASE;
use crate::keys::{Keys, MAX_LIFETIME, PublisherClock, PublisherInfo};
use crate::publication::{PublicationError, lock};
use crate::remote_request::{
    CLIENTS, MAX_REQUEST_BYTES, PUBLISHED, RENEW, SEND, SUBSCRIBE, UNSUBSCRIBE, is_acting,
};

/// Time for the answer after a request has begun: that of the publisher for its service, and of the network.
const ANSWER: Duration = Duration::from_secs(15);
/// Interval of renewing a subscription.
const RENEWAL: Duration = Duration::from_secs(LEASE.as_secs() / 3);
/// Bytes of frames in one request, and requests of a channel without an answer.
const MAX_SEND_BYTES: usize = MAX_REQUEST_BYTES / 2;
const MAX_SENDS: usize = 4;
const READ_BYTES: usize = 64 << 10;

/// Numbers the subscriptions of this process.
static SUBSCRIPTIONS: AtomicU64 = AtomicU64::new(0);

/// What the threads of Zenoh share with that of the connection.
#[derive(Debug)]
struct Shared {
    session: Session,
    keys: Keys,
    client: String,
    info: PublisherInfo,
    clock: PublisherClock,
    output: ConnectionOutput,
    own: Mutex<OwnFrames>,
    lanes: Mutex<BTreeMap<(u16, u8), Lane>>,
    /// Period and gateways that the client knows.
    layout: Mutex<Option<GatewaysChanged>>,
}

/// Frames of a channel on their way to the publisher.
#[derive(Debug, Default)]
struct Lane {
    /// Requests without an answer.
    open: usize,
    /// Frames that wait, with the time of their arrival.
    waiting: VecDeque<(TransmitRecord, Instant)>,
}

/// A subscription of the client; it ends when this is dropped.
#[derive(Debug)]
struct Subscribed {
    name: String,
    accounts: Arc<Mutex<Accounts>>,
    renewed: Instant,
    _samples: Subscriber<()>,
}

#[derive(Debug)]
pub(crate) struct RemoteConnection {
    shared: Arc<Shared>,
    subscription: Option<Subscribed>,
    _states: Subscriber<()>,
    _presence: Subscriber<()>,
}

impl RemoteConnection {
    /// Connects to the publisher of `info`; `stream` leads to the client.
    pub(crate) fn new(
        (session, keys, client): (Session, Keys, String),
        info: PublisherInfo,
        clock: PublisherClock,
        stream: &UnixStream,
    ) -> Result<Self, PublicationError> {
        let stream = stream.try_clone();
        let stream =
            stream.map_err(|error| PublicationError::Open { reason: error.to_string() })?;
        let shared = Arc::new(Shared {
            session: session.clone(),
            keys: keys.clone(),
            client,
            info,
            clock,
            output: ConnectionOutput::new(stream),
            own: Mutex::default(),
            lanes: Mutex::default(),
            layout: Mutex::default(),
        });
        let states = keys.method("*");
        let taking = shared.clone();
        let _states = session
            .declare_subscriber(&states)
            .callback(move |sample| taking.take_state(&sample))
            .wait()
            .map_err(PublicationError::session("observe", &states))?;
        let alive = keys.alive(&shared.info.publisher);
        let watching = shared.clone();
        let end = move |sample: Sample| {
            if sample.kind() == SampleKind::Delete {
                watching.output.close();
            }
        };
        let presence = session.liveliness().declare_subscriber(&alive).history(true).callback(end);
        let _presence = presence.wait().map_err(PublicationError::session("observe", &alive))?;
        Ok(Self { shared, subscription: None, _states, _presence })
    }

    /// Serves the client until one side ends.
    pub(crate) fn serve(mut self, mut stream: UnixStream) {
        let shared = self.shared.clone();
        thread::scope(|scope| {
            scope.spawn(|| shared.output.write());
            let mut reader = MessageReader::new(Sender::Client);
            let mut buffer = vec![0; READ_BYTES];
            let mut is_open = stream.set_read_timeout(Some(RENEWAL)).is_ok();
            while is_open {
                match stream.read(&mut buffer) {
                    Ok(0) => is_open = false,
                    Ok(count) => {
                        reader.push(buffer.get(..count).unwrap_or_default());
                        is_open = self.take_messages(&mut reader);
                    }
                    Err(error) => {
                        use ErrorKind::{Interrupted, TimedOut, WouldBlock};
                        is_open = [Interrupted, TimedOut, WouldBlock].contains(&error.kind());
                    }
                }
                self.renew();
            }
            shared.output.close();
        });
        if let Some(ended) = self.subscription.take() {
            self.end(ended);
        }
    }

    /// Takes all messages that are complete; returns false after a fault.
    fn take_messages(&mut self, reader: &mut MessageReader) -> bool {
        loop {
            match reader.next_message() {
                Ok(None) => return true,
                Ok(Some((MessageKind::Transmit, payload))) => {
                    let Ok(records) = TransmitRecords::new(payload).collect::<Result<Vec<_>, _>>()
                    else {
                        return false;
                    };
                    self.shared.send(&records);
                }
                Ok(Some((_, payload))) => match RawRequest::parse(payload) {
                    Ok(request) => self.take_request(&request),
                    Err(response) => self.shared.output.respond(&response),
                },
                Err(_) => return false,
            }
        }
    }

    fn take_request(&mut self, request: &RawRequest) {
        let (id, method) = (request.id.clone(), request.method.clone());
        let mut params = request.params_value();
        let age = Duration::from_millis(request.max_age_ms.unwrap_or(DEFAULT_MAX_AGE_MS).into());
        match &*method {
            SUBSCRIBE => {
                let subscribed = self.shared.subscribe();
                let subscribed = match subscribed {
                    Ok(subscribed) => subscribed,
                    Err(error) => {
                        let error = RpcError::new(NOT_AVAILABLE, error.to_string());
                        return self.shared.output.respond(&Response::error(id, error));
                    }
                };
                if params.is_null() {
                    params = json!({});
                }
                // The publisher rejects what is no object.
                if let Some(members) = params.as_object_mut() {
                    members.insert("subscription".into(), subscribed.name.clone().into());
                }
                if let Some(former) = self.subscription.replace(subscribed) {
                    self.end(former);
                }
            }
            UNSUBSCRIBE => {
                if let Some(ended) = self.subscription.take() {
                    self.end(ended);
                }
                return self.shared.output.respond(&Response::result(id, json!({})));
            }
            method if method.starts_with("images.") => {
                let text = format!("{method} is not available through Zenoh");
                let error = RpcError::new(METHOD_NOT_FOUND, text);
                return self.shared.output.respond(&Response::error(id, error));
            }
            _ => {}
        }
        let shared = self.shared.clone();
        let answer = method.clone();
        self.shared.request(&method, &params, age, move |result| {
            shared.output.respond(&match result {
                Ok(result) => Response::result(id.clone(), shared.known(&answer, result)),
                Err(error) => Response::error(id.clone(), error),
            });
        });
    }

    /// Extends the subscription in time. Without an answer until its end frames would be missing.
    fn renew(&mut self) {
        let Some(subscribed) = &mut self.subscription else { return };
        if subscribed.renewed.elapsed() < RENEWAL {
            return;
        }
        subscribed.renewed = Instant::now();
        let (shared, accounts) = (self.shared.clone(), subscribed.accounts.clone());
        let params = json!({ "subscription": subscribed.name });
        self.shared.request(RENEW, &params, LEASE, move |result| match result {
            Ok(info) => {
                if let Ok(info) = serde_json::from_value::<SubscriptionInfo>(info) {
                    shared.output.push_frames(&[], lock(&accounts).take_published(info));
                }
            }
            Err(error) if error.message == NO_ANSWER => {}
            Err(_) => shared.output.close(),
        });
    }

    fn end(&self, ended: Subscribed) {
        let params = json!({ "subscription": ended.name });
        self.shared.request(UNSUBSCRIBE, &params, LEASE, |_| ());
    }
}

/// Text of the error without an answer.
const NO_ANSWER: &str =
    "the publisher did not answer in time; whether the request was executed is not known";

impl Shared {
    /// Sends a request; `take` gets its result, or an error without an answer.
    fn request(
        &self,
        method: &str,
        params: &Value,
        age: Duration,
        take: impl Fn(Result<Value, RpcError>) + Send + Sync + 'static,
    ) {
        let payload = match params {
            Value::Null => Vec::new(),
            params => params.to_string().into_bytes(),
        };
        let age = age.min(MAX_LIFETIME);
        let pending = Pending { is_answered: AtomicBool::new(false), take };
        self.get(method, payload, is_acting(method).then_some(age), move |reply| {
            pending.answer(match reply {
                Ok(payload) => serde_json::from_slice(payload)
                    .map_err(|_| RpcError::new(NOT_AVAILABLE, NO_ANSWER)),
                Err(error) => Err(error),
            });
        });
    }

    /// Sends a request with a deadline, if it acts. `take` gets the answer, and is dropped without one.
    fn get(
        &self,
        method: &str,
        payload: Vec<u8>,
        age: Option<Duration>,
        take: impl Fn(Result<&[u8], RpcError>) + Send + Sync + 'static,
    ) {
        let key = self.keys.request(&self.info.publisher, &self.client, method);
        let deadline = age.map(|age| self.clock.deadline(age).to_vec());
        let get = self.session.get(&key).payload(payload).attachment(deadline);
        let get = get.timeout(ANSWER + age.unwrap_or_default());
        let callback = move |reply: Reply| match reply.into_result() {
            Ok(sample) => take(Ok(&sample.payload().to_bytes())),
            Err(error) => take(Err(serde_json::from_slice(&error.payload().to_bytes())
                .unwrap_or_else(|_| RpcError::new(NOT_AVAILABLE, NO_ANSWER)))),
        };
        if let Err(error) = get.callback(callback).wait() {
            // The callback was dropped, which is an answer.
            tracing::debug!("zenoh: {key} not sent: {error}");
        }
    }

    /// Takes note of the gateways in the response to `hello`, which has the access of this client.
    fn known(&self, method: &str, mut result: Value) -> Value {
        if method == methods::SayHello::NAME {
            let PublisherInfo { access, access_reason, .. } = &self.info;
            result["access"] = serde_json::to_value(access).unwrap_or_default();
            result["access_reason"] = serde_json::to_value(access_reason).unwrap_or_default();
            *lock(&self.layout) = layout_of(&result);
        }
        result
    }

    /// Passes on a notification of the service, and a change of its gateways.
    fn take_state(&self, sample: &Sample) {
        let publisher = sample.attachment().map(|identity| identity.to_bytes());
        if publisher.as_deref() != Some(self.info.publisher.as_bytes()) {
            return;
        }
        let method = sample.key_expr().as_str().rsplit('/').next().unwrap_or_default();
        let Ok(params) = serde_json::from_slice::<Value>(&sample.payload().to_bytes()) else {
            return;
        };
        if method == methods::SayHello::NAME {
            let Some(new) = layout_of(&params) else { return };
            let mut known = lock(&self.layout);
            if known.as_ref().is_some_and(|known| *known != new) {
                let params = serde_json::to_value(&new).unwrap_or_default();
                self.output.respond(&Response::notification("gateways", params));
                *known = Some(new);
            }
        } else if !PUBLISHED.contains(&method) && method != CLIENTS {
            self.output.respond(&Response::notification(method, params));
        }
    }

    fn subscribe(self: &Arc<Self>) -> Result<Subscribed, PublicationError> {
        let number = SUBSCRIPTIONS.fetch_add(1, Ordering::Relaxed);
        let name = format!("{}-{number}", self.session.zid());
        let key = self.keys.subscription(&name, "*", "*");
        let accounts = Arc::<Mutex<Accounts>>::default();
        let (shared, counting) = (self.clone(), accounts.clone());
        let samples = self.session.declare_subscriber(&key);
        let samples = samples.callback(move |sample| shared.take_frames(&sample, &counting)).wait();
        let _samples = samples.map_err(PublicationError::session("observe", &key))?;
        Ok(Subscribed { name, accounts, renewed: Instant::now(), _samples })
    }

    fn take_frames(&self, sample: &Sample, accounts: &Mutex<Accounts>) {
        let head = sample.attachment().map(|head| BatchHead::decode(&head.to_bytes()));
        let Some(Ok(head)) = head else { return };
        let Some(reports) = reports_of(&sample.payload().to_bytes()) else { return };
        let Some(first) = reports.first() else { return };
        let address = (first.gateway, first.channel);
        let lost = lock(accounts).take(address, head, reports.len() as u64);
        let mut own = lock(&self.own);
        let others: Vec<_> = reports.into_iter().filter(|report| !own.take_echo(report)).collect();
        drop(own);
        self.output.push_frames(&others, lost);
    }

    /// Sends frames of the client in their order.
    fn send(self: &Arc<Self>, records: &[TransmitRecord]) {
        let now = Instant::now();
        let mut lanes = lock(&self.lanes);
        for record in records {
            let lane = lanes.entry((record.gateway, record.channel)).or_default();
            lane.waiting.push_back((*record, now));
        }
        let addresses: Vec<_> = lanes.keys().copied().collect();
        drop(lanes);
        addresses.into_iter().for_each(|address| self.send_waiting(address));
    }

    /// Sends what waits in a lane while it is open.
    fn send_waiting(self: &Arc<Self>, address: (u16, u8)) {
        loop {
            let (records, age) = {
                let mut lanes = lock(&self.lanes);
                let Some(lane) = lanes.get_mut(&address) else { return };
                let Some((_, arrived)) = lane.waiting.front().copied() else { return };
                if lane.open == MAX_SENDS {
                    return;
                }
                lane.open += 1;
                let most = MAX_SEND_BYTES / size_of::<TransmitRecord>();
                let count = lane.waiting.len().min(most);
                let records: Vec<_> =
                    lane.waiting.drain(..count).map(|(record, _)| record).collect();
                (records, MAX_LIFETIME.saturating_sub(arrived.elapsed()))
            };
            let mut payload = Vec::new();
            records.iter().for_each(|record| record.encode(&mut payload));
            lock(&self.own).expect(&records);
            let sent = Sent { shared: self.clone(), address, records, is_answered: false.into() };
            self.get(SEND, payload, Some(age), move |reply| sent.answer(reply));
        }
    }
}

/// A request without an answer.
struct Pending<F: Fn(Result<Value, RpcError>)> {
    is_answered: AtomicBool,
    take: F,
}

impl<F: Fn(Result<Value, RpcError>)> Pending<F> {
    fn answer(&self, result: Result<Value, RpcError>) {
        if !self.is_answered.swap(true, Ordering::AcqRel) {
            (self.take)(result);
        }
    }
}

impl<F: Fn(Result<Value, RpcError>)> Drop for Pending<F> {
    fn drop(&mut self) {
        self.answer(Err(RpcError::new(NOT_AVAILABLE, NO_ANSWER)));
    }
}

/// Frames that the publisher has not answered.
struct Sent {
    shared: Arc<Shared>,
    address: (u16, u8),
    records: Vec<TransmitRecord>,
    is_answered: AtomicBool,
}

impl Sent {
    /// Reports the results; without an answer they are not known.
    fn answer(&self, reply: Result<&[u8], RpcError>) {
        if self.is_answered.swap(true, Ordering::AcqRel) {
            return;
        }
        let reports = reply.map(|payload| reports_of(payload).unwrap_or_default());
        let event_of = |record: &TransmitRecord| match &reports {
            Ok(reports) => reports.iter().find(|report| report.tag == record.tag).copied(),
            Err(error) => {
                let event = rejection(error).map_or(FrameEvent::Unknown, FrameEvent::Rejected);
                Some(report_of(record, event))
            }
        };
        let unknown = |record| report_of(record, FrameEvent::Unknown);
        let results: Vec<_> = self
            .records
            .iter()
            .map(|record| event_of(record).unwrap_or_else(|| unknown(record)))
            .collect();
        let rejected = |report: &&FrameReport| matches!(report.event, FrameEvent::Rejected(_));
        lock(&self.shared.own).withdraw(results.iter().filter(rejected));
        self.shared.output.push_results(&results);
        if let Some(lane) = lock(&self.shared.lanes).get_mut(&self.address) {
            lane.open -= 1;
        }
        self.shared.send_waiting(self.address);
    }
}

impl Drop for Sent {
    fn drop(&mut self) {
        self.answer(Err(RpcError::new(NOT_AVAILABLE, NO_ANSWER)));
    }
}

/// Reports in a payload of the publisher; `None` of a malformed one.
fn reports_of(payload: &[u8]) -> Option<Vec<FrameReport>> {
    let report = |record| match record {
        Ok(FrameRecord::Frame(report)) => Some(report),
        _ => None,
    };
    FrameRecords::new(payload).map(report).collect()
}

fn report_of(record: &TransmitRecord, event: FrameEvent) -> FrameReport {
    let TransmitRecord { gateway, channel, tag, frame, .. } = *record;
    FrameReport { time_ns: 0, gateway, channel, tag, event, frame }
}

/// Reason of a rejection; `None` if frames may have been sent.
fn rejection(error: &RpcError) -> Option<RejectReason> {
    match error.code {
        NOT_AVAILABLE => None,
        NOT_PERMITTED => Some(RejectReason::ReadOnly),
        BUSY => Some(RejectReason::Window),
        EXPIRED => Some(RejectReason::Expired),
        _ => Some(RejectReason::Closed),
    }
}

fn layout_of(hello: &Value) -> Option<GatewaysChanged> {
    let Hello { cycle_ns, gateways, .. } = serde_json::from_value(hello.clone()).ok()?;
    Some(GatewaysChanged { cycle_ns, gateways })
}
