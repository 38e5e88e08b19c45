//! Queries of remote clients.

use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::thread;
use std::time::Duration;

use ecan_service_client::{
    Access, BUSY, Client, ClientError, Event, FrameReport, INTERNAL_ERROR, Method as _,
    NOT_AVAILABLE, NOT_PERMITTED, RpcError, methods,
};
use serde_json::Value;
use zenoh::Wait as _;
use zenoh::bytes::Encoding;
use zenoh::key_expr::keyexpr;
use zenoh::query::Query;

use crate::publication::{Publication, Published, lock};
use crate::publication_error::PublicationError;
use crate::remote_request::{PUBLISHED, SEND, check, frames_to_send, parameters};
use crate::transmit_jobs::TransmitJobs;

/// Threads for requests: fewer than the service has, so that slow SDO transfers of remote clients do
/// not block the requests of others.
const WORKERS: usize = 3;
/// Queries that may wait, of each kind.
const MAX_WAITING: usize = 64;
/// Interval of looking for the end.
const POLL: Duration = Duration::from_millis(100);

/// Answers the queries of remote clients.
#[derive(Debug)]
pub(crate) struct RemoteClients<'a> {
    pub(crate) publication: &'a Publication,
    pub(crate) published: &'a Published,
    pub(crate) caller: Client,
    /// Sends frames; `None` without control.
    pub(crate) sender: Option<Client>,
}

impl RemoteClients<'_> {
    /// Answers queries while `body` runs.
    pub(crate) fn serve_during(
        &self,
        body: impl FnOnce(&Client) -> Result<(), PublicationError>,
    ) -> Result<(), PublicationError> {
        let (requests, waiting_requests) = sync_channel(MAX_WAITING);
        let (sends, waiting_sends) = sync_channel(MAX_WAITING);
        let [waiting_requests, waiting_sends] = [waiting_requests, waiting_sends].map(Mutex::new);
        let is_ended = AtomicBool::new(false);
        let jobs = TransmitJobs::default();
        let Publication { session, config } = self.publication;
        thread::scope(|scope| {
            // Ends the threads also after a panic.
            let _end = OnDrop(|| is_ended.store(true, Ordering::Release));
            for _ in 0..WORKERS {
                scope.spawn(|| {
                    while let Some(query) = next(&waiting_requests, &is_ended) {
                        self.answer(&query);
                    }
                });
            }
            scope.spawn(|| {
                while let Some(query) = next(&waiting_sends, &is_ended) {
                    self.send(query, &jobs);
                }
            });
            if let Some(sender) = &self.sender {
                scope.spawn(|| take_results(sender, &jobs, &is_ended));
            }
            let (send_key, requests_too) = (config.keys.method(SEND), requests.clone());
            let all_methods = config.keys.method("*");
            let _methods = session
                .declare_queryable(&all_methods)
                .callback(move |query: Query| {
                    let is_send = query.key_expr().as_str() == send_key;
                    enqueue(query, if is_send { &sends } else { &requests });
                })
                .wait()
                .map_err(PublicationError::session("answer", &all_methods))?;
            let all_frames = config.keys.method("frames/*/*");
            let _frames = session
                .declare_queryable(&all_frames)
                .callback(move |query: Query| enqueue(query, &requests_too))
                .wait()
                .map_err(PublicationError::session("answer", &all_frames))?;
            let alive = self.publication.token();
            let _alive = session
                .liveliness()
                .declare_token(&alive)
                .wait()
                .map_err(PublicationError::session("declare", &alive))?;
            body(&self.caller)
        })
    }

    /// Answers a request, or one for the present counters of frames.
    fn answer(&self, query: &Query) {
        let keys = &self.publication.config.keys;
        let key = query.key_expr();
        if let Some(method) = keys.method_of(key.as_str()) {
            return reply_json(query, key.as_str(), self.call(method, query));
        }
        // With wildcards: everything that is published.
        for method in PUBLISHED.iter().chain(&[methods::SayHello::NAME]) {
            let name = keys.method(method);
            if is_selected(key, &name)
                && let Ok(value) = self.call(method, query)
            {
                reply_json(query, &name, Ok(value));
            }
        }
        let gateways = lock(&self.published.hello).gateways.clone();
        for (index, gateway) in (0..).zip(&gateways) {
            for channel in &gateway.channels {
                let name = keys.frames(index, channel.channel);
                if is_selected(key, &name) {
                    let head = lock(&self.published.batches).head((index, channel.channel));
                    let reply = query.reply(&name, Vec::new()).attachment(head.encode());
                    log_failure(reply.wait());
                }
            }
        }
    }

    fn call(&self, method: &str, query: &Query) -> Result<Value, RpcError> {
        if method == methods::SayHello::NAME {
            let hello = serde_json::to_value(&*lock(&self.published.hello));
            return hello.map_err(|error| RpcError::new(INTERNAL_ERROR, error.to_string()));
        }
        check(method, self.publication.config.has_control)?;
        let payload = query.payload().map(|it| it.to_bytes()).unwrap_or_default();
        let result = self.caller.call(method, parameters(method, &payload)?);
        result.map_err(|error| rpc_error(&error))
    }

    fn send(&self, query: Query, jobs: &TransmitJobs) {
        let payload = query.payload().map(|it| it.to_bytes()).unwrap_or_default();
        let ready = self.transmitter().and_then(|it| Ok((it, frames_to_send(&payload)?)));
        drop(payload);
        match ready {
            Ok((client, records)) => jobs.send(
                |it| client.send(it.gateway, it.channel, &it.frame),
                records,
                Box::new(move |result| match result {
                    Ok(reports) => reply_records(&query, &reports),
                    Err(error) => reply_error(&query, &error),
                }),
            ),
            Err(error) => reply_error(&query, &error),
        }
    }

    /// The client that sends, if remote clients may.
    fn transmitter(&self) -> Result<&Client, RpcError> {
        check(SEND, self.publication.config.has_control)?;
        match &self.sender {
            Some(client) if client.hello().access == Access::Control => Ok(client),
            client => {
                let reason = client.as_ref().and_then(|it| it.hello().access_reason.clone());
                let reason = reason.unwrap_or_else(|| "the service is read-only".into());
                Err(RpcError::new(NOT_PERMITTED, format!("{SEND} is not permitted: {reason}")))
            }
        }
    }
}

fn is_selected(selector: &keyexpr, key: &str) -> bool {
    keyexpr::new(key).is_ok_and(|key| selector.intersects(key))
}

/// Adds a query to those that wait. Runs on a thread of Zenoh, so it never waits itself.
fn enqueue(query: Query, queue: &SyncSender<Query>) {
    if let Err(error) = queue.try_send(query) {
        let (std::sync::mpsc::TrySendError::Full(query)
        | std::sync::mpsc::TrySendError::Disconnected(query)) = error;
        let text = format!("{MAX_WAITING} queries are pending; retry later");
        reply_error(&query, &RpcError::new(BUSY, text));
    }
}

/// The next query; `None` at the end.
fn next(queue: &Mutex<Receiver<Query>>, is_ended: &AtomicBool) -> Option<Query> {
    while !is_ended.load(Ordering::Acquire) {
        match lock(queue).recv_timeout(POLL) {
            Ok(query) => return Some(query),
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => break,
        }
    }
    None
}

fn take_results(sender: &Client, jobs: &TransmitJobs, is_ended: &AtomicBool) {
    while !is_ended.load(Ordering::Acquire) {
        match sender.poll(POLL) {
            Ok(Some(Event::Frame(report))) => jobs.take_result(report),
            Ok(_) => {}
            Err(error) => return jobs.end(&rpc_error(&error)),
        }
    }
    jobs.end(&RpcError::new(NOT_AVAILABLE, "the publication ends"));
}

fn rpc_error(error: &ClientError) -> RpcError {
    match error.rpc() {
        Some(error) => error.clone(),
        None => RpcError::new(NOT_AVAILABLE, error.to_string()),
    }
}

fn reply_json(query: &Query, key: &str, result: Result<Value, RpcError>) {
    match result {
        Ok(value) => {
            let reply = query.reply(key, value.to_string()).encoding(Encoding::APPLICATION_JSON);
            log_failure(reply.wait());
        }
        Err(error) => reply_error(query, &error),
    }
}

fn reply_records(query: &Query, reports: &[FrameReport]) {
    let mut records = Vec::new();
    reports.iter().for_each(|report| report.encode(&mut records));
    log_failure(query.reply(query.key_expr(), records).wait());
}

fn reply_error(query: &Query, error: &RpcError) {
    let error = serde_json::to_string(error).unwrap_or_default();
    log_failure(query.reply_err(error).encoding(Encoding::APPLICATION_JSON).wait());
}

/// The client may have gone.
fn log_failure(result: zenoh::Result<()>) {
    if let Err(error) = result {
        tracing::debug!("zenoh: reply failed: {error}");
    }
}

struct OnDrop<F: Fn()>(F);

impl<F: Fn()> Drop for OnDrop<F> {
    fn drop(&mut self) {
        (self.0)();
    }
}
