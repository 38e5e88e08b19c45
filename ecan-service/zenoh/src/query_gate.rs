//! Admission of queries: what is answered at once, what waits for its turn, and what is rejected.

use std::sync::{Arc, Condvar, Mutex, PoisonError};

use ecan_service::client::{
    Access, BUSY, FrameReport, Hello, METHOD_NOT_FOUND, Method as _, NOT_AVAILABLE, RpcError,
    methods,
};
use serde_json::Value;
use zenoh::Wait as _;
use zenoh::bytes::Encoding;
use zenoh::key_expr::keyexpr;
use zenoh::query::Query;

use crate::client_counts::{ClientCounts, RejectedRequests};
use crate::client_turns::{ClientTurns, TurnLimits};
use crate::frame_batches::{FrameBatches, Stream};
use crate::keys::{Keys, MAX_LIFETIME, PublisherInfo, RequestKey, now_ns};
use crate::presence::Presence;
use crate::publication::lock;
use crate::remote_request::{PUBLISHED, SEND, check_name, check_size, is_acting, not_addressed};

/// Threads for requests: fewer than the service has, so that slow SDO transfers of remote clients do
/// not block the requests of others.
pub(crate) const WORKERS: usize = 3;
/// Limits of the queries that wait. A client that sends many delays and rejects its own only: one
/// worker remains for the others.
const QUERY_LIMITS: TurnLimits =
    TurnLimits { clients: 32, items: 16, bytes: 4 << 20, running: WORKERS - 1 };

/// State that the threads of Zenoh share with those of the publication.
#[derive(Debug)]
pub(crate) struct QueryGate {
    pub(crate) keys: Keys,
    pub(crate) presence: Presence,
    pub(crate) hello: Mutex<Hello>,
    pub(crate) batches: Arc<Mutex<FrameBatches>>,
    pub(crate) rejected: Arc<Mutex<RejectedRequests>>,
    pub(crate) clients: Arc<Mutex<ClientCounts>>,
    /// Requests that the workers execute.
    pub(crate) requests: QueryQueue,
    /// Requests that send frames.
    pub(crate) sends: QueryQueue,
}

impl QueryGate {
    /// Answers, queues or rejects a query. Runs on a thread of Zenoh, so it never waits.
    pub(crate) fn admit(&self, query: Query) {
        let key = query.key_expr().clone();
        let request = self.keys.request_of(key.as_str());
        let bytes = [query.payload(), query.attachment()].into_iter().flatten();
        let bytes = bytes.map(|part| part.len()).sum::<usize>()
            + key.as_str().len()
            + query.parameters().as_str().len();
        // The publisher that is addressed answers.
        let is_of_other = request.is_some_and(|request| !self.is_addressed(&request));
        if is_of_other && self.presence.other().is_some() {
            return;
        }
        let checked = check_size(bytes).and_then(|()| match request {
            Some(request) => self.check_request(&request),
            None => Ok(()),
        });
        if let Err(error) = checked {
            return reply_error(&query, &error);
        }
        if let Some(RequestKey { client, publisher: Some(_), .. }) = request {
            lock(&self.clients).count_request(client);
        }
        match request {
            Some(RequestKey { client, method: SEND, .. }) => {
                self.enqueue(&self.sends, client, &query, bytes);
            }
            Some(RequestKey { client, .. }) => self.enqueue(&self.requests, client, &query, bytes),
            None => self.answer_selection(query, bytes),
        }
    }

    /// Returns whether a request is for this publisher, or for any.
    fn is_addressed(&self, request: &RequestKey<'_>) -> bool {
        request.publisher.is_none_or(|publisher| publisher == self.presence.publisher)
    }

    fn check_request(&self, request: &RequestKey<'_>) -> Result<(), RpcError> {
        let RequestKey { publisher, client, method } = *request;
        if !self.is_addressed(request) {
            let text = "the publisher that the request addresses does not exist any more; nothing \
                        was done; get PREFIX/publisher/*";
            return Err(RpcError::new(NOT_AVAILABLE, text));
        }
        match publisher {
            Some(_) => check_name("client", client)?,
            None if is_acting(method) => return Err(not_addressed(method)),
            // Zenoh delivers one of two equal answers: this one would pass for the only one.
            None => self.presence.check_prefix()?,
        }
        if is_acting(method) {
            self.presence.check_prefix()?;
        }
        self.presence.check_service()
    }

    fn enqueue(&self, queue: &QueryQueue, client: &str, query: &Query, bytes: usize) {
        if let Err(error) = queue.push(client, query, bytes) {
            lock(&self.rejected).full += 1;
            if !client.is_empty() {
                lock(&self.clients).count_rejected(client);
            }
            reply_error(query, &error);
        }
    }

    /// Answers a query for published keys. What needs the service waits for its turn.
    fn answer_selection(&self, query: Query, bytes: usize) {
        let key = query.key_expr().clone();
        let is_selected = |name: &str| is_selected(&key, name);
        let mut is_answered = false;
        let own = self.keys.publisher(&self.presence.publisher);
        if is_selected(&own) {
            is_answered = true;
            let info = serde_json::to_value(self.info()).unwrap_or_default();
            self.reply_json(&query, &own, Ok(info));
        }
        let hello = self.keys.method(methods::SayHello::NAME);
        if is_selected(&hello) {
            is_answered = true;
            self.reply_json(&query, &hello, self.hello());
        }
        let gateways = lock(&self.hello).gateways.clone();
        for (index, gateway) in (0..).zip(&gateways) {
            for channel in &gateway.channels {
                let name = self.keys.frames(index, channel.channel);
                if is_selected(&name) {
                    is_answered = true;
                    let stream =
                        Stream { subscription: None, gateway: index, channel: channel.channel };
                    let head = lock(&self.batches).head(&stream);
                    let reply = query.reply(&name, Vec::new()).attachment(head.encode());
                    log_failure(reply.wait());
                }
            }
        }
        if PUBLISHED.iter().any(|method| is_selected(&self.keys.method(method))) {
            return self.enqueue(&self.requests, "", &query, bytes);
        }
        if !is_answered {
            let text = format!("{key} does not exist at this publisher; see docs/SERVICE.md");
            reply_error(&query, &RpcError::new(METHOD_NOT_FOUND, text));
        }
    }

    pub(crate) fn hello(&self) -> Result<Value, RpcError> {
        Ok(serde_json::to_value(&*lock(&self.hello)).unwrap_or_default())
    }

    /// The remote clients, for the operator.
    pub(crate) fn clients(&self) -> Value {
        let batches = lock(&self.batches);
        serde_json::to_value(lock(&self.clients).list(&batches)).unwrap_or_default()
    }

    fn info(&self) -> PublisherInfo {
        let (mut access, mut access_reason) = {
            let hello = lock(&self.hello);
            (hello.access, hello.access_reason.clone())
        };
        let checked = self.presence.check_prefix().and_then(|()| self.presence.check_service());
        if let (Access::Control, Err(error)) = (access, checked) {
            (access, access_reason) = (Access::Read, Some(error.message));
        }
        PublisherInfo {
            publisher: self.presence.publisher.clone(),
            now_ns: now_ns(),
            max_lifetime_ms: MAX_LIFETIME.as_millis() as u64,
            epoch: lock(&self.batches).epoch(),
            access,
            access_reason,
        }
    }

    pub(crate) fn reply_json(&self, query: &Query, key: &str, result: Result<Value, RpcError>) {
        match result {
            Ok(value) => {
                let reply = query.reply(key, value.to_string());
                let reply = reply.encoding(Encoding::APPLICATION_JSON);
                log_failure(reply.attachment(self.presence.publisher.as_bytes()).wait());
            }
            Err(error) => reply_error(query, &error),
        }
    }

    /// Answers what still waits at the end.
    pub(crate) fn close(&self) {
        let error = RpcError::new(NOT_AVAILABLE, "the publication ends; nothing was done");
        for queue in [&self.requests, &self.sends] {
            queue.close().iter().for_each(|query| reply_error(query, &error));
        }
    }
}

pub(crate) fn is_selected(selector: &keyexpr, key: &str) -> bool {
    keyexpr::new(key).is_ok_and(|key| selector.intersects(key))
}

/// Queries of all clients, which take turns.
#[derive(Debug)]
pub(crate) struct QueryQueue {
    state: Mutex<(ClientTurns<Query>, bool)>,
    changed: Condvar,
}

impl QueryQueue {
    pub(crate) fn new() -> Self {
        let state = Mutex::new((ClientTurns::new(QUERY_LIMITS), false));
        Self { state, changed: Condvar::new() }
    }

    fn push(&self, client: &str, query: &Query, bytes: usize) -> Result<(), RpcError> {
        let mut state = lock(&self.state);
        let (turns, is_closed) = &mut *state;
        if *is_closed {
            let text = "the publication ends; nothing was done";
            return Err(RpcError::new(NOT_AVAILABLE, text));
        }
        // A clone of a query shares its content.
        match turns.push(client, std::iter::once(query.clone()), bytes) {
            Ok(()) => {
                drop(state);
                self.changed.notify_all();
                Ok(())
            }
            Err(full) => {
                let text = format!("{full}; nothing was done; retry after a reply");
                Err(RpcError::new(BUSY, text))
            }
        }
    }

    /// The next query with its client; `None` at the end. The caller passes the client to
    /// [`finish`](Self::finish).
    pub(crate) fn next(&self) -> Option<(String, Query)> {
        let mut state = lock(&self.state);
        loop {
            if state.1 {
                return None;
            }
            if let Some(next) = state.0.take(|_| true) {
                return Some(next);
            }
            state = self.changed.wait(state).unwrap_or_else(PoisonError::into_inner);
        }
    }

    pub(crate) fn finish(&self, client: &str) {
        lock(&self.state).0.finish(client);
        self.changed.notify_all();
    }

    fn close(&self) -> Vec<Query> {
        let mut state = lock(&self.state);
        state.1 = true;
        let waiting = state.0.drain();
        drop(state);
        self.changed.notify_all();
        waiting
    }
}

pub(crate) fn reply_records(query: &Query, reports: &[FrameReport]) {
    let mut records = Vec::new();
    reports.iter().for_each(|report| report.encode(&mut records));
    log_failure(query.reply(query.key_expr(), records).wait());
}

pub(crate) fn reply_error(query: &Query, error: &RpcError) {
    let error = serde_json::to_string(error).unwrap_or_default();
    log_failure(query.reply_err(error).encoding(Encoding::APPLICATION_JSON).wait());
}

/// The client may have gone.
fn log_failure(result: zenoh::Result<()>) {
    if let Err(error) = result {
        tracing::debug!("zenoh: reply failed: {error}");
    }
}
