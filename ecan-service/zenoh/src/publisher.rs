//! The threads that publish frames and states.

use std::path::Path;
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::sync::{Arc, Mutex};
use std::thread;
use std::time::{Duration, Instant};

use ecan_service::client::{Client, ClientError, Event, Method as _, Subscription, methods};
use serde_json::Value;
use zenoh::Wait as _;
use zenoh::bytes::Encoding;
use zenoh::qos::CongestionControl;

use crate::client_counts::RejectedRequests;
use crate::frame_account::BatchHead;
use crate::frame_batches::Stream;
use crate::presence::Presence;
use crate::publication::{Publication, PublicationError, PublicationEvent, lock};
use crate::query_gate::{QueryGate, QueryQueue};
use crate::remote_clients::RemoteClients;
use crate::remote_request::{CLIENTS, PUBLISHED};

/// Interval of looking for a change of state.
const CHANGES: Duration = Duration::from_millis(100);
/// Interval of looking for the end and for connections.
const POLL: Duration = Duration::from_millis(100);
/// Least time between two reports of rejected requests.
const PAUSE: Duration = Duration::from_secs(1);
/// Time for a response of the service: that of a Zenoh query.
const REQUEST_TIMEOUT: Duration = Duration::from_secs(10);

impl Publication {
    /// Publishes the service at `socket` until `is_stopped` returns true.
    ///
    /// # Errors
    /// The service cannot be connected or ended: call again when it runs again.
    pub fn run(
        &self,
        socket: &Path,
        is_stopped: &dyn Fn() -> bool,
        report: &dyn Fn(PublicationEvent),
    ) -> Result<(), PublicationError> {
        let connect = |name: &str| {
            let mut client = Client::connect(socket, name)?;
            client.set_request_timeout(REQUEST_TIMEOUT);
            Ok::<_, ClientError>(client)
        };
        let observer = connect("ecan zenoh: frames")?;
        let caller = connect("ecan zenoh: requests")?;
        let sender = match self.config.has_control {
            true => Some(connect("ecan zenoh: transmit")?),
            false => None,
        };
        lock(&self.batches).begin_connection();
        let gate = Arc::new(QueryGate {
            keys: self.config.keys.clone(),
            presence: Presence::new(),
            hello: Mutex::new(self.remote_hello(caller.hello())),
            batches: self.batches.clone(),
            rejected: self.rejected.clone(),
            clients: self.clients.clone(),
            requests: QueryQueue::new(),
            sends: QueryQueue::new(),
        });
        observer.subscribe(&Subscription::default())?;
        let remote = RemoteClients { publication: self, gate: &gate, caller, sender };
        remote.serve_during(|caller| {
            let publisher = Publisher { publication: self, gate: &gate, caller };
            publisher.run(&observer, is_stopped, report)
        })
    }
}

/// State that was reported last: each change is reported once.
#[derive(Default)]
struct Notices {
    links: Option<PublicationEvent>,
    other: Option<String>,
    is_silent: bool,
    rejected: RejectedRequests,
    /// Time of the last report of rejected requests.
    rejected_at: Option<Instant>,
}

impl Notices {
    fn report_changes(
        &mut self,
        publication: &Publication,
        presence: &Presence,
        report: &dyn Fn(PublicationEvent),
    ) {
        let links = publication.links();
        if self.links.as_ref() != Some(&links) {
            report(links.clone());
            self.links = Some(links);
        }
        let other = presence.other();
        if other.is_some() != self.other.is_some() {
            report(match &other {
                Some(token) => PublicationEvent::PrefixInUse { token: token.clone() },
                None => PublicationEvent::PrefixFree,
            });
        }
        self.other = other;
        if presence.is_silent() != self.is_silent {
            self.is_silent = !self.is_silent;
            report(match self.is_silent {
                true => PublicationEvent::ServiceSilent,
                false => PublicationEvent::ServiceResponds,
            });
        }
        while let Some(name) = lock(&publication.clients).take_new() {
            report(PublicationEvent::Client(name));
        }
        let rejected = *lock(&publication.rejected);
        if rejected != self.rejected && self.rejected_at.is_none_or(|at| at.elapsed() > PAUSE) {
            report(PublicationEvent::Rejected(rejected));
            (self.rejected, self.rejected_at) = (rejected, Some(Instant::now()));
        }
    }
}

/// Publishes frames and states.
struct Publisher<'a> {
    publication: &'a Publication,
    gate: &'a QueryGate,
    caller: &'a Client,
}

impl Publisher<'_> {
    fn run(
        &self,
        observer: &Client,
        is_stopped: &dyn Fn() -> bool,
        report: &dyn Fn(PublicationEvent),
    ) -> Result<(), PublicationError> {
        self.put_hello()?;
        let mut notices = Notices::default();
        thread::scope(|scope| {
            // Dropped at the end, which ends the other thread.
            let (_end, ended) = channel();
            scope.spawn(move || self.publish_states(&ended));
            while !is_stopped() {
                notices.report_changes(self.publication, &self.gate.presence, report);
                self.publish_frames(observer)?;
            }
            Ok(())
        })
    }

    /// Publishes the states at each interval, and those that have changed, until the sender is dropped.
    /// A request may wait for slow SDO transfers of other clients.
    fn publish_states(&self, ended: &Receiver<()>) {
        let interval = self.publication.config.interval;
        let mut published: Option<Instant> = None;
        let mut known = PUBLISHED.map(|_| Value::Null);
        loop {
            let is_due = published.is_none_or(|at| at.elapsed() >= interval);
            for (method, known) in PUBLISHED.iter().zip(&mut known) {
                // Counters change all the time.
                if !is_due && [methods::ReadServiceStats::NAME, CLIENTS].contains(method) {
                    continue;
                }
                let state = match *method {
                    CLIENTS => Ok(self.gate.clients()),
                    method => self.caller.call(method, Value::Null).map_err(PublicationError::from),
                };
                // For example without a cycle. The publishing thread reports a lost connection.
                let result = state.and_then(|state| {
                    let before = std::mem::replace(known, without_varying(&state));
                    let is_changed = before != *known;
                    if is_due || is_changed { self.put_json(method, &state) } else { Ok(()) }
                });
                result.unwrap_or_else(|error| {
                    tracing::debug!("zenoh: {method} not published: {error}")
                });
            }
            if is_due {
                published = Some(Instant::now());
            }
            // Notifications, which the observer has as well.
            while let Ok(Some(_)) = self.caller.poll(Duration::ZERO) {}
            if ended.recv_timeout(CHANGES.min(interval)) == Err(RecvTimeoutError::Disconnected) {
                break;
            }
        }
    }

    /// Publishes what arrives until [`POLL`] has passed.
    fn publish_frames(&self, observer: &Client) -> Result<(), PublicationError> {
        let end = Instant::now() + POLL;
        while let Some(event) = observer.poll(end.saturating_duration_since(Instant::now()))? {
            self.take(event)?;
            self.gather(observer)?;
            self.put_frames()?;
            if Instant::now() >= end {
                break;
            }
        }
        Ok(())
    }

    /// Takes further events for a short time.
    fn gather(&self, observer: &Client) -> Result<(), PublicationError> {
        let end = Instant::now() + self.publication.config.gather;
        loop {
            let left = end.saturating_duration_since(Instant::now());
            match observer.poll(left)? {
                Some(event) if !left.is_zero() => self.take(event)?,
                Some(event) => return self.take(event),
                None => return Ok(()),
            }
        }
    }

    fn take(&self, event: Event) -> Result<(), PublicationError> {
        match event {
            Event::Frame(report) => {
                let is_full = lock(&self.gate.batches).push(&report);
                if is_full { self.put_frames() } else { Ok(()) }
            }
            Event::Lost(lost) => {
                lock(&self.gate.batches).lose(lost.frames + lost.frames_in_client);
                Ok(())
            }
            Event::Gateways(changed) => {
                {
                    let mut hello = lock(&self.gate.hello);
                    (hello.cycle_ns, hello.gateways) = (changed.cycle_ns, changed.gateways);
                }
                self.put_hello()
            }
            Event::Notification { method, params } => {
                // Its name need not be a key.
                let put = self.put_json(&method, &params);
                put.unwrap_or_else(|error| tracing::warn!("zenoh: {error}"));
                Ok(())
            }
            _ => Ok(()),
        }
    }

    fn put_frames(&self) -> Result<(), PublicationError> {
        let batches = lock(&self.gate.batches).take();
        let keys = &self.publication.config.keys;
        for (Stream { subscription, gateway, channel }, head, records) in batches {
            let key = match subscription {
                Some(name) => keys.subscription(&name, gateway, channel),
                None => keys.frames(gateway, channel),
            };
            self.put(&key, records, Some(head))?;
        }
        Ok(())
    }

    fn put_hello(&self) -> Result<(), PublicationError> {
        let hello = serde_json::to_value(&*lock(&self.gate.hello)).unwrap_or_default();
        self.put_json(methods::SayHello::NAME, &hello)
    }

    fn put_json(&self, method: &str, value: &Value) -> Result<(), PublicationError> {
        let key = self.publication.config.keys.method(method);
        self.put(&key, value.to_string().into_bytes(), None)
    }

    /// Publishes without waiting: what a slow host does not take is lost for it.
    fn put(
        &self,
        key: &str,
        payload: Vec<u8>,
        head: Option<BatchHead>,
    ) -> Result<(), PublicationError> {
        let put = self.publication.session.put(key, payload);
        let put = put.congestion_control(CongestionControl::Drop);
        let result = match head {
            Some(head) => put.attachment(head.encode()).wait(),
            None => {
                let publisher = self.gate.presence.publisher.as_bytes();
                put.encoding(Encoding::APPLICATION_JSON).attachment(publisher).wait()
            }
        };
        result.map_err(PublicationError::session("publish", key))
    }
}

/// Members of states that change without an event: times, counters and positions.
const VARYING: [&str; 16] = [
    "app_time_ns",
    "time_ns",
    "run_time_ns",
    "late_ns",
    "elapsed_ns",
    "run_time",
    "late",
    "overruns",
    "skipped",
    "statistics",
    "actual",
    "actual_age",
    "actual_degrees",
    "target",
    "following_error",
    "working_counter",
];

/// What tells of an event in a state.
fn without_varying(state: &Value) -> Value {
    match state {
        Value::Array(values) => values.iter().map(without_varying).collect(),
        Value::Object(members) => {
            let is_varying = |name: &str, value: &Value| {
                // A number of this name counts cycles, an object describes the cycle.
                VARYING.contains(&name) || (name == "cycle" && value.is_number())
            };
            let kept = members.iter().filter(|(name, value)| !is_varying(name, value));
            kept.map(|(name, value)| (name.clone(), without_varying(value))).collect()
        }
        value => value.clone(),
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn state_without_an_event_is_equal() {
        let state = |cycle: u64, session: &str, sent: u64| {
            let gateway = json!({ "session": session, "statistics": { "sent": sent } });
            json!({ "cycle": { "cycle": cycle, "is_closed": false }, "gateways": [gateway] })
        };
        let first = without_varying(&state(1, "waiting", 0));
        assert_eq!(first, without_varying(&state(2, "waiting", 7)));
        assert_ne!(first, without_varying(&state(1, "ready", 0)));
        let axes = |actual: i32, phase: &str| {
            without_varying(
                &json!({ "cycle": actual, "axes": [{ "actual": actual, "phase": phase }] }),
            )
        };
        assert!(axes(1, "running") == axes(2, "running") && axes(1, "off") != axes(1, "running"));
    }
}
