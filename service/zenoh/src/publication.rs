//! The publication of a service.

use std::fmt;
use std::path::Path;
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel, sync_channel};
use std::sync::{Mutex, PoisonError};
use std::thread;
use std::time::{Duration, Instant, SystemTime};

use ecan_service_client::{Client, ClientError, Event, Hello, Method as _, Subscription, methods};
use serde_json::Value;
use zenoh::bytes::Encoding;
use zenoh::pubsub::Subscriber;
use zenoh::qos::CongestionControl;
use zenoh::sample::SampleKind;
use zenoh::{Session, Wait as _};

use crate::batch_head::BatchHead;
use crate::frame_batches::FrameBatches;
use crate::keys::Keys;
use crate::publication_error::PublicationError;
use crate::remote_clients::RemoteClients;
use crate::remote_request::PUBLISHED;
use crate::zenoh_config;

/// Time that the first frame of a batch waits for further ones.
const GATHER: Duration = Duration::from_millis(5);
/// Interval of looking for the end and for connections.
const POLL: Duration = Duration::from_millis(100);
/// Time for a response of the service: that of a Zenoh query.
const REQUEST_TIMEOUT: Duration = Duration::from_secs(10);

/// Settings of a publication.
#[derive(Debug, Clone)]
pub struct PublicationConfig {
    /// Key expressions.
    pub keys: Keys,
    /// Remote clients may send frames and change something, if the service permits it to this
    /// process.
    pub has_control: bool,
    /// Interval of the states.
    pub interval: Duration,
}

/// Event of a publication, with its text for users.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub enum PublicationEvent {
    /// The connections of the session, at the start and after each change.
    Links {
        /// Zenoh routers.
        routers: usize,
        /// Zenoh peers; clients that connect to a listener are not counted.
        peers: usize,
    },
    /// Another session publishes under the same keys: its data and these are mixed.
    PrefixInUse {
        /// Key of its liveliness token, which ends with its Zenoh ID.
        token: String,
    },
}

impl fmt::Display for PublicationEvent {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Links { routers, peers } => {
                write!(f, "zenoh: connected to {routers} routers, {peers} peers")
            }
            Self::PrefixInUse { token } => {
                write!(f, "warning: another publisher uses the prefix ({token}); set --prefix")
            }
        }
    }
}

/// A Zenoh session that publishes services.
#[derive(Debug)]
pub struct Publication {
    pub(crate) session: Session,
    pub(crate) config: PublicationConfig,
}

/// What the publishing thread shares with those that answer queries.
#[derive(Debug)]
pub(crate) struct Published {
    pub(crate) hello: Mutex<Hello>,
    pub(crate) batches: Mutex<FrameBatches>,
}

impl Publication {
    /// Opens a session with a configuration file of Zenoh (JSON5), unchanged; nothing listens and
    /// multicast scouting is off unless it is configured.
    ///
    /// # Errors
    /// The file is wrong, or the session does not open.
    pub fn open(file: &Path, config: PublicationConfig) -> Result<Self, PublicationError> {
        let session = zenoh::open(zenoh_config::read(file)?).wait();
        let session =
            session.map_err(|error| PublicationError::Open { reason: error.to_string() })?;
        Ok(Self { session, config })
    }

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
        let epoch = SystemTime::UNIX_EPOCH.elapsed().unwrap_or_default().as_nanos();
        let published = Published {
            hello: Mutex::new(self.remote_hello(caller.hello())),
            batches: Mutex::new(FrameBatches::new(u64::try_from(epoch).unwrap_or_default())),
        };
        observer.subscribe(&Subscription::default())?;
        let remote = RemoteClients { publication: self, published: &published, caller, sender };
        remote.serve_during(|caller| {
            let publisher = Publisher { publication: self, published: &published, caller };
            publisher.run(&observer, is_stopped, report)
        })
    }

    fn links(&self) -> PublicationEvent {
        let info = self.session.info();
        let (routers, peers) = (info.routers_zid().wait(), info.peers_zid().wait());
        PublicationEvent::Links { routers: routers.count(), peers: peers.count() }
    }

    /// Key of the liveliness token.
    pub(crate) fn token(&self) -> String {
        self.config.keys.alive(&self.session.zid().to_string())
    }

    /// Reports other publishers with the same keys.
    fn watch_prefix(&self) -> Result<(Subscriber<()>, Receiver<String>), PublicationError> {
        let (sender, others) = sync_channel(1);
        let (own, tokens) = (self.token(), self.config.keys.alive("*"));
        let subscriber = self.session.liveliness().declare_subscriber(&tokens).history(true);
        let subscriber = subscriber.callback(move |token| {
            if token.kind() == SampleKind::Put && token.key_expr().as_str() != own {
                // One is enough.
                let _ = sender.try_send(token.key_expr().to_string());
            }
        });
        let subscriber =
            subscriber.wait().map_err(PublicationError::session("observe", &tokens))?;
        Ok((subscriber, others))
    }

    /// The response to `hello`, with the access of remote clients.
    fn remote_hello(&self, hello: &Hello) -> Hello {
        let mut hello = hello.clone();
        if !self.config.has_control {
            hello.access = ecan_service_client::Access::Read;
            hello.access_reason =
                Some("remote clients only read; start ecan zenoh with --control".into());
        }
        hello
    }
}

/// Publishes frames and states.
struct Publisher<'a> {
    publication: &'a Publication,
    published: &'a Published,
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
        let (_subscriber, others) = self.publication.watch_prefix()?;
        let mut links = None;
        thread::scope(|scope| {
            // Dropped at the end, which ends the other thread.
            let (_end, ended) = channel();
            scope.spawn(move || self.publish_states(&ended));
            while !is_stopped() {
                let found = self.publication.links();
                if links.as_ref() != Some(&found) {
                    report(found.clone());
                    links = Some(found);
                }
                if let Ok(token) = others.try_recv() {
                    report(PublicationEvent::PrefixInUse { token });
                }
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
                let is_full = lock(&self.published.batches).push(&report);
                if is_full { self.put_frames() } else { Ok(()) }
            }
            Event::Lost(lost) => {
                lock(&self.published.batches).lose(lost.frames + lost.frames_in_client);
                Ok(())
            }
            Event::Gateways(changed) => {
                {
                    let mut hello = lock(&self.published.hello);
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
        let batches = lock(&self.published.batches).take();
        for ((gateway, channel), head, records) in batches {
            let key = self.publication.config.keys.frames(gateway, channel);
            self.put(&key, records, Some(head))?;
        }
        Ok(())
    }

    fn put_hello(&self) -> Result<(), PublicationError> {
        let hello = serde_json::to_value(&*lock(&self.published.hello)).unwrap_or_default();
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
            None => put.encoding(Encoding::APPLICATION_JSON).wait(),
        };
        result.map_err(PublicationError::session("publish", key))
    }
}

pub(crate) fn lock<T>(mutex: &Mutex<T>) -> std::sync::MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
