//! Requests of remote clients.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::channel;
use std::thread;
use std::time::{Duration, Instant};

use ecan_service::client::{
    Access, Client, ClientError, EXPIRED, Event, FrameEvent, INTERNAL_ERROR, Method as _,
    NOT_AVAILABLE, NOT_PERMITTED, RejectReason, RpcError, TransmitRecord, methods,
};
use serde_json::{Value, json};
use zenoh::Wait as _;
use zenoh::query::Query;

use crate::frame_account::SubscriptionInfo;
use crate::frame_batches::LEASE;
use crate::keys::{check_deadline, now_ns};
use crate::publication::{Publication, PublicationError, lock};
use crate::query_gate::{QueryGate, WORKERS, is_selected, reply_error, reply_records};
use crate::remote_request::{
    CLIENTS, PUBLISHED, RENEW, SEND, SUBSCRIBE, UNSUBSCRIBE, check, check_frames_of,
    frames_to_send, is_acting, parameters, subscription_of,
};
use crate::transmit_jobs::TransmitJobs;

/// Interval of looking for the end and for late frames.
const POLL: Duration = Duration::from_millis(100);

/// Executes the requests of remote clients.
#[derive(Debug)]
pub(crate) struct RemoteClients<'a> {
    pub(crate) publication: &'a Publication,
    pub(crate) gate: &'a Arc<QueryGate>,
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
        let is_ended = AtomicBool::new(false);
        let window = self.sender.as_ref().map_or(0, |sender| sender.hello().window);
        let jobs = TransmitJobs::new(window);
        let Publication { session, config, .. } = self.publication;
        thread::scope(|scope| {
            // Ends the threads also after a panic.
            let _end = OnDrop(|| {
                is_ended.store(true, Ordering::Release);
                self.gate.close();
            });
            for _ in 0..WORKERS {
                scope.spawn(|| {
                    while let Some((client, query)) = self.gate.requests.next() {
                        self.answer(&client, &query);
                        self.gate.requests.finish(&client);
                    }
                });
            }
            scope.spawn(|| {
                while let Some((client, query)) = self.gate.sends.next() {
                    self.send(&client, query, &jobs);
                    self.gate.sends.finish(&client);
                }
            });
            if let Some(sender) = &self.sender {
                scope.spawn(|| self.take_results(sender, &jobs, &is_ended));
                scope.spawn(|| self.send_waiting(sender, &jobs, &is_ended));
            }
            let (_end_presence, presence_ended) = channel();
            let presence = &self.gate.presence;
            scope.spawn(move || presence.run(self.publication, &self.caller, &presence_ended));
            let _others = presence.watch_others(self.publication)?;
            let all = config.keys.method("**");
            let gate = self.gate.clone();
            let _queries = session
                .declare_queryable(&all)
                .callback(move |query: Query| gate.admit(query))
                .wait()
                .map_err(PublicationError::session("answer", &all))?;
            body(&self.caller)
        })
    }

    /// Answers a request, or a query with wildcards for what is published.
    fn answer(&self, client: &str, query: &Query) {
        let keys = &self.publication.config.keys;
        let key = query.key_expr();
        if let Some(request) = keys.request_of(key.as_str()) {
            let result = self.call(client, request.method, query);
            return self.gate.reply_json(query, key.as_str(), result);
        }
        for method in PUBLISHED {
            let name = keys.method(method);
            if is_selected(key, &name)
                && let Ok(value) = self.call(client, method, query)
            {
                self.gate.reply_json(query, &name, Ok(value));
            }
        }
    }

    fn call(&self, client: &str, method: &str, query: &Query) -> Result<Value, RpcError> {
        match method {
            methods::SayHello::NAME => return self.gate.hello(),
            CLIENTS => return Ok(self.gate.clients()),
            _ => {}
        }
        let config = &self.publication.config;
        let is_subscription = [SUBSCRIBE, UNSUBSCRIBE, RENEW].contains(&method);
        let is_served = is_subscription && !client.is_empty();
        if !is_served {
            check(method, config.has_control)?;
        }
        let payload = query.payload().map(|payload| payload.to_bytes()).unwrap_or_default();
        let params = parameters(method, &payload)?;
        drop(payload);
        if is_served {
            return self.subscribe(client, method, params);
        }
        let result = if is_acting(method) {
            check_frames_of(method, &params, &config.limits)?;
            let (deadline, now) = self.deadline(method, query)?;
            self.caller.call_before(method, params, Duration::from_nanos(deadline - now))
        } else {
            self.caller.call(method, params)
        };
        result.map_err(|error| self.rpc_error(&error))
    }

    /// Begins, extends or ends a subscription.
    fn subscribe(&self, client: &str, method: &str, params: Value) -> Result<Value, RpcError> {
        let (name, selection) = subscription_of(method, params)?;
        let (mut batches, now) = (lock(&self.gate.batches), Instant::now());
        let head = match method {
            SUBSCRIBE => batches.subscribe((client, &name), selection, now)?,
            RENEW => batches.renew(&name, now)?,
            _ => {
                batches.unsubscribe(&name);
                return Ok(json!({}));
            }
        };
        let published = batches.published(&name);
        drop(batches);
        serde_json::to_value(SubscriptionInfo::new(head, published, LEASE))
            .map_err(|error| RpcError::new(INTERNAL_ERROR, error.to_string()))
    }

    /// Deadline of a request that acts, and the present time. The request may have waited for its
    /// turn.
    fn deadline(&self, method: &str, query: &Query) -> Result<(u64, u64), RpcError> {
        let attachment = query.attachment().map(|bytes| bytes.to_bytes()).unwrap_or_default();
        let now = now_ns();
        let deadline = check_deadline(method, &attachment, now);
        Ok((deadline.inspect_err(|error| self.count(error))?, now))
    }

    /// Counts a late request.
    fn count(&self, error: &RpcError) {
        if error.code == EXPIRED {
            self.publication.count_late(1);
        }
    }

    fn rpc_error(&self, error: &ClientError) -> RpcError {
        let error = rpc_error(error);
        self.count(&error);
        error
    }

    fn send(&self, client: &str, query: Query, jobs: &TransmitJobs) {
        match self.frames(&query) {
            Ok((records, (deadline, now))) => {
                lock(&self.gate.clients).count_frames(client, records.len());
                jobs.add(
                    client,
                    &records,
                    (now, deadline),
                    Box::new(move |result| match result {
                        Ok(reports) => reply_records(&query, &reports),
                        Err(error) => reply_error(&query, &error),
                    }),
                );
            }
            Err(error) => reply_error(&query, &error),
        }
    }

    /// Frames to send with their deadline and the present time, if remote clients may send them.
    fn frames(&self, query: &Query) -> Result<(Vec<TransmitRecord>, (u64, u64)), RpcError> {
        let config = &self.publication.config;
        check(SEND, config.has_control)?;
        let hello = self.sender.as_ref().map(|sender| sender.hello());
        if hello.is_none_or(|hello| hello.access != Access::Control) {
            let reason = hello.and_then(|hello| hello.access_reason.clone());
            let reason = reason.unwrap_or_else(|| "the service is read-only".into());
            return Err(RpcError::new(NOT_PERMITTED, format!("{SEND} is not permitted: {reason}")));
        }
        let payload = query.payload().map(|payload| payload.to_bytes()).unwrap_or_default();
        let records = frames_to_send(&payload, &config.limits)?;
        Ok((records, self.deadline(SEND, query)?))
    }

    /// Passes on the results of sent frames until the end.
    fn take_results(&self, sender: &Client, jobs: &TransmitJobs, is_ended: &AtomicBool) {
        while !is_ended.load(Ordering::Acquire) {
            match sender.poll(POLL) {
                Ok(Some(Event::Frame(report))) => {
                    let is_late = report.event == FrameEvent::Rejected(RejectReason::Expired);
                    self.publication.count_late(is_late.into());
                    jobs.take_result(report);
                }
                Ok(_) => {}
                Err(error) => return jobs.end(&rpc_error(&error)),
            }
        }
        jobs.end(&RpcError::new(NOT_AVAILABLE, "the publication ends"));
    }

    /// Sends frames whose turn has come until the end.
    fn send_waiting(&self, sender: &Client, jobs: &TransmitJobs, is_ended: &AtomicBool) {
        let window = sender.hello().window;
        while !is_ended.load(Ordering::Acquire) {
            jobs.wait(POLL);
            // What is written to a service that does not read it would wait there.
            let is_silent = self.gate.presence.is_silent();
            let late = jobs.send_waiting(
                now_ns,
                |gateway, channel| !is_silent && sender.in_flight(gateway, channel) < window,
                |TransmitRecord { gateway, channel, frame, .. }, left| {
                    sender.send_within(*gateway, *channel, frame, left)
                },
            );
            if late > 0 {
                self.publication.count_late(late);
            }
        }
    }
}

fn rpc_error(error: &ClientError) -> RpcError {
    match error.rpc() {
        Some(error) => error.clone(),
        None => RpcError::new(NOT_AVAILABLE, error.to_string()),
    }
}

struct OnDrop<F: Fn()>(F);

impl<F: Fn()> Drop for OnDrop<F> {
    fn drop(&mut self) {
        (self.0)();
    }
}
