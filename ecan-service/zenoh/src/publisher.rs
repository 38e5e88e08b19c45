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

use crate::frame_account::BatchHead;
use crate::presence::Presence;
use crate::publication::{Publication, PublicationError, PublicationEvent, RejectedRequests, lock};
use crate::query_gate::{QueryGate, QueryQueue};
use crate::remote_clients::RemoteClients;
use crate::remote_request::PUBLISHED;

/// Time that the first frame of a batch waits for further ones.
const GATHER: Duration = Duration::from_millis(5);
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

    /// Publishes the states at each interval until the sender is dropped. A request may wait for
    /// slow SDO transfers of other clients.
    fn publish_states(&self, ended: &Receiver<()>) {
        loop {
            for method in PUBLISHED {
                let state = self.caller.call(method, Value::Null).map_err(PublicationError::from);
                // For example without a cycle. The publishing thread reports a lost connection.
                if let Err(error) = state.and_then(|state| self.put_json(method, &state)) {
                    tracing::debug!("zenoh: {method} not published: {error}");
                }
            }
            // Notifications, which the observer has as well.
            while let Ok(Some(_)) = self.caller.poll(Duration::ZERO) {}
            if ended.recv_timeout(self.publication.config.interval)
                == Err(RecvTimeoutError::Disconnected)
            {
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
        let end = Instant::now() + GATHER;
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
        for ((gateway, channel), head, records) in batches {
            let key = self.publication.config.keys.frames(gateway, channel);
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
