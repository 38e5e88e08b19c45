//! A publication on a thread of its own, and sessions of other hosts.

use std::net::{Shutdown, TcpListener, TcpStream};
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, channel};
use std::sync::{Arc, Condvar, Mutex};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use ecan_service::client::{FrameRecord, FrameRecords, FrameReport, RpcError, TransmitRecord};
use ecan_service_zenoh::{
    BatchHead, Keys, Publication, PublicationConfig, PublicationError, PublicationEvent,
    PublisherClock, PublisherInfo, TransmitLimits,
};
use nix::sys::socket::setsockopt;
use nix::sys::socket::sockopt::RcvBuf;
use serde_json::Value;
use zenoh::handlers::FifoChannelHandler;
use zenoh::pubsub::Subscriber;
use zenoh::query::Reply;
use zenoh::sample::Sample;
use zenoh::{Config, Session, Wait as _};

use crate::common::{Fixture, PATIENCE, frame, wait_for};

pub const PREFIX: &str = "bench/cell/master0";
/// Lifetime of requests whose age is not the subject.
pub const LIFETIME: Duration = Duration::from_secs(10);

pub type Samples = Subscriber<FifoChannelHandler<Sample>>;

pub struct Published {
    pub stop: Arc<AtomicBool>,
    pub thread: Option<JoinHandle<Result<(), PublicationError>>>,
    pub remote: Session,
    pub events: Receiver<PublicationEvent>,
    pub open_control: Option<String>,
}

pub fn write_config(directory: &Path, text: &str) -> PathBuf {
    let path = directory.join("zenoh.json5");
    std::fs::write(&path, text).unwrap();
    path
}

pub fn config(has_control: bool) -> PublicationConfig {
    let (keys, limits) = (Keys::new(PREFIX).unwrap(), TransmitLimits::default());
    PublicationConfig {
        keys,
        has_control,
        limits,
        interval: Duration::from_millis(50),
        gather: Duration::from_millis(5),
    }
}

/// Publishes to a session that connects to the publisher.
pub fn publish(fixture: &Fixture, has_control: bool) -> Published {
    publish_with(fixture, &fixture.path(), config(has_control))
}

/// Publishes the service at a socket.
pub fn publish_with(fixture: &Fixture, socket: &Path, config: PublicationConfig) -> Published {
    let address = free_address("tcp");
    let remote = || open_remote(&address, "").unwrap();
    publish_by(fixture, socket, config, &format!("listen: {}", endpoints(&address)), remote)
}

pub fn endpoints(address: &str) -> String {
    format!("{{ endpoints: ['{address}'] }}")
}

/// An address of this host that was free a moment ago.
pub fn free_address(protocol: &str) -> String {
    let address = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap();
    format!("{protocol}/{address}")
}

pub fn open_remote(address: &str, settings: &str) -> zenoh::Result<Session> {
    open_session(&format!("mode: 'client', connect: {}, {settings}", endpoints(address)))
}

pub fn open_session(settings: &str) -> zenoh::Result<Session> {
    let text = format!("{{ scouting: {{ multicast: {{ enabled: false }} }}, {settings} }}");
    zenoh::open(Config::from_json5(&text)?).wait()
}

/// Publishes with these settings of Zenoh to a session that is opened afterwards.
pub fn publish_by(
    fixture: &Fixture,
    socket: &Path,
    config: PublicationConfig,
    settings: &str,
    open_remote: impl FnOnce() -> Session,
) -> Published {
    let file = write_config(fixture.directory.path(), &format!("{{ {settings} }}"));
    let publication = Publication::open(&file, config).unwrap();
    let open_control = publication.open_control().map(str::to_owned);
    let (stop, socket) = (Arc::new(AtomicBool::new(false)), socket.to_owned());
    let is_stopped = stop.clone();
    let (events, received) = channel();
    let thread = std::thread::spawn(move || {
        let report = |event| drop(events.send(event));
        publication.run(&socket, &|| is_stopped.load(Ordering::Acquire), &report)
    });
    let thread = Some(thread);
    let published =
        Published { stop, thread, remote: open_remote(), events: received, open_control };
    wait_for("the token", || published.is_alive());
    published
}

impl Published {
    pub fn is_alive(&self) -> bool {
        let replies = self.remote.liveliness().get(key("alive/*")).wait().unwrap();
        replies.recv().is_ok()
    }

    pub fn subscribe(&self, selector: &str) -> Samples {
        self.remote.declare_subscriber(key(selector)).wait().unwrap()
    }

    pub fn replies(&self, selector: &str, payload: Vec<u8>) -> Vec<Reply> {
        replies(&self.remote, selector, payload, None, PATIENCE)
    }

    /// The only reply.
    pub fn get(&self, selector: &str, payload: Vec<u8>) -> Result<Sample, RpcError> {
        only(selector, self.replies(selector, payload))
    }

    pub fn call(&self, method: &str, params: Value) -> Result<Value, RpcError> {
        self.get(method, params.to_string().into_bytes()).map(|sample| json_of(&sample))
    }

    /// Calls a method that acts.
    pub fn act(&self, method: &str, params: Value) -> Result<Value, RpcError> {
        let payload = params.to_string().into_bytes();
        Remote::of(&self.remote, "test").act(method, payload).map(|sample| json_of(&sample))
    }

    pub fn send(&self, records: &[TransmitRecord]) -> Result<Vec<FrameReport>, RpcError> {
        let reply = Remote::of(&self.remote, "test").act("send", payload_of(records));
        reply.map(|sample| reports(&sample))
    }

    /// Waits for an event; others before it are skipped.
    pub fn wait_for_event(
        &self,
        is_wanted: impl Fn(&PublicationEvent) -> bool,
    ) -> PublicationEvent {
        let end = Instant::now() + PATIENCE;
        loop {
            let left = end.saturating_duration_since(Instant::now());
            let event = self.events.recv_timeout(left).expect("the event");
            if is_wanted(&event) {
                return event;
            }
        }
    }

    pub fn end(mut self) -> Result<(), PublicationError> {
        self.stop.store(true, Ordering::Release);
        self.thread.take().unwrap().join().unwrap()
    }
}

impl Drop for Published {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Release);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

/// A remote client with its name and the clock of the only publisher.
pub struct Remote<'a> {
    session: &'a Session,
    name: &'a str,
    pub info: PublisherInfo,
    clock: PublisherClock,
}

impl<'a> Remote<'a> {
    pub fn of(session: &'a Session, name: &'a str) -> Self {
        let mut found = publishers(session);
        assert_eq!(found.len(), 1, "{found:?}");
        let info = found.remove(0);
        Self { session, name, clock: PublisherClock::new(&info, Instant::now()), info }
    }

    pub fn act(&self, method: &str, payload: Vec<u8>) -> Result<Sample, RpcError> {
        let deadline = self.clock.deadline(LIFETIME).to_vec();
        only(method, self.replies(method, payload, Some(deadline), PATIENCE))
    }

    /// Replies to a request with this attachment.
    pub fn replies(
        &self,
        method: &str,
        payload: Vec<u8>,
        attachment: Option<Vec<u8>>,
        timeout: Duration,
    ) -> Vec<Reply> {
        self.start(method, payload, attachment, timeout).into_iter().collect()
    }

    /// Starts a request with this attachment; the replies follow.
    pub fn start(
        &self,
        method: &str,
        payload: Vec<u8>,
        attachment: Option<Vec<u8>>,
        timeout: Duration,
    ) -> FifoChannelHandler<Reply> {
        let keys = Keys::new(PREFIX).unwrap();
        let key = keys.request(&self.info.publisher, self.name, method);
        let rest = key.strip_prefix(PREFIX).unwrap().trim_start_matches('/');
        start(self.session, rest, payload, attachment, timeout)
    }

    pub fn deadline(&self, lifetime: Duration) -> Vec<u8> {
        self.clock.deadline(lifetime).to_vec()
    }
}

/// All publishers that answer.
pub fn publishers(session: &Session) -> Vec<PublisherInfo> {
    let replies = replies(session, "publisher/*", Vec::new(), None, PATIENCE);
    let info = |reply: Reply| serde_json::from_value(json_of(&reply.into_result().unwrap()));
    replies.into_iter().map(|reply| info(reply).unwrap()).collect()
}

fn replies(
    session: &Session,
    selector: &str,
    payload: Vec<u8>,
    attachment: Option<Vec<u8>>,
    timeout: Duration,
) -> Vec<Reply> {
    start(session, selector, payload, attachment, timeout).into_iter().collect()
}

fn start(
    session: &Session,
    selector: &str,
    payload: Vec<u8>,
    attachment: Option<Vec<u8>>,
    timeout: Duration,
) -> FifoChannelHandler<Reply> {
    let get = session.get(key(selector)).payload(payload).timeout(timeout);
    let replies = match attachment {
        Some(attachment) => get.attachment(attachment).wait(),
        None => get.wait(),
    };
    replies.unwrap()
}

fn only(selector: &str, mut replies: Vec<Reply>) -> Result<Sample, RpcError> {
    assert_eq!(replies.len(), 1, "{selector}: {replies:?}");
    replies
        .remove(0)
        .into_result()
        .map_err(|error| serde_json::from_slice(&error.payload().to_bytes()).expect("an RpcError"))
}

pub fn key(rest: &str) -> String {
    format!("{PREFIX}/{rest}")
}

pub fn json_of(sample: &Sample) -> Value {
    serde_json::from_slice(&sample.payload().to_bytes()).unwrap()
}

pub fn head(sample: &Sample) -> BatchHead {
    BatchHead::decode(&sample.attachment().expect("a head").to_bytes()).unwrap()
}

pub fn reports(sample: &Sample) -> Vec<FrameReport> {
    let record = |record| match record {
        Ok(FrameRecord::Frame(report)) => report,
        other => panic!("{other:?}"),
    };
    FrameRecords::new(&sample.payload().to_bytes()).map(record).collect()
}

pub fn next(samples: &Samples) -> Sample {
    samples.recv_timeout(PATIENCE).unwrap().expect("a sample")
}

pub fn record(channel: u8, tag: u32, data: &[u8]) -> TransmitRecord {
    TransmitRecord { gateway: 0, channel, tag, max_age_ms: 0, frame: frame(0x123, data) }
}

pub fn payload_of(records: &[TransmitRecord]) -> Vec<u8> {
    let mut payload = Vec::new();
    records.iter().for_each(|record| record.encode(&mut payload));
    payload
}

/// Frames that the cycle has sent on the bus.
pub fn sent_frames(fixture: &Fixture) -> u64 {
    fixture.statistics().channels.iter().map(|channel| channel.frames_accepted).sum()
}

/// A link that can be held: what is written to a held link arrives after the release.
pub struct Link {
    /// Address of its near end, for TCP.
    pub address: String,
    gate: Arc<(Mutex<bool>, Condvar)>,
}

/// A stream with two ends.
pub trait Stream: std::io::Read + std::io::Write + Send + Sized + 'static {
    fn duplicate(&self) -> Self;
    fn close(&self);
}

impl Stream for TcpStream {
    fn duplicate(&self) -> Self {
        self.try_clone().unwrap()
    }

    fn close(&self) {
        let _ = self.shutdown(Shutdown::Both);
    }
}

impl Stream for UnixStream {
    fn duplicate(&self) -> Self {
        self.try_clone().unwrap()
    }

    fn close(&self) {
        let _ = self.shutdown(Shutdown::Both);
    }
}

impl Link {
    /// A link to a TCP address of Zenoh.
    pub fn to_address(address: &str) -> Self {
        Self::to_tcp(address, |_| ())
    }

    /// As [`to_address`](Self::to_address); a held link keeps few bytes.
    pub fn to_narrow_address(address: &str) -> Self {
        Self::to_tcp(address, |far| setsockopt(far, RcvBuf, &4096).unwrap())
    }

    fn to_tcp(address: &str, prepare: impl Fn(&TcpStream) + Send + 'static) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let near = format!("tcp/{}", listener.local_addr().unwrap());
        let far = address.strip_prefix("tcp/").unwrap().to_owned();
        let accept = move || {
            let (near, _) = listener.accept().ok()?;
            let far = TcpStream::connect(&far).ok()?;
            prepare(&far);
            Some((near, far))
        };
        Self::start(near, accept)
    }

    /// A link to a Unix socket, at `path`.
    pub fn to_socket(path: &Path, socket: PathBuf) -> Self {
        let listener = UnixListener::bind(path).unwrap();
        let accept = move || Some((listener.accept().ok()?.0, UnixStream::connect(&socket).ok()?));
        Self::start(String::new(), accept)
    }

    /// The threads end with the streams, the accepting one with the test.
    fn start<S: Stream>(
        address: String,
        mut accept: impl FnMut() -> Option<(S, S)> + Send + 'static,
    ) -> Self {
        let gate = Arc::new((Mutex::new(false), Condvar::new()));
        let shared = gate.clone();
        std::thread::spawn(move || {
            while let Some((near, far)) = accept() {
                for (from, to) in [(near.duplicate(), far.duplicate()), (far, near)] {
                    let gate = shared.clone();
                    std::thread::spawn(move || forward(from, to, &gate));
                }
            }
        });
        Self { address, gate }
    }

    pub fn set_held(&self, is_held: bool) {
        *self.gate.0.lock().unwrap() = is_held;
        self.gate.1.notify_all();
    }
}

impl Drop for Link {
    fn drop(&mut self) {
        self.set_held(false);
    }
}

fn forward<S: Stream>(mut from: S, mut to: S, (is_held, changed): &(Mutex<bool>, Condvar)) {
    let mut buffer = [0; 64 << 10];
    while let Ok(count @ 1..) = from.read(&mut buffer) {
        drop(changed.wait_while(is_held.lock().unwrap(), |is_held| *is_held).unwrap());
        if to.write_all(&buffer[..count]).is_err() {
            break;
        }
    }
    to.close();
    from.close();
}
