//! A service published to another Zenoh session on this host.
#![allow(missing_docs)]

#[path = "../../server/tests/common/mod.rs"]
mod common;

use std::net::TcpListener;
use std::path::Path;
use std::process::Command;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, channel};
use std::thread::JoinHandle;
use std::time::Duration;

use ecan_service::Control;
use ecan_service_client::{
    BAD_RECORD, BUS_ERROR, FrameEvent, FrameRecord, FrameRecords, FrameReport, METHOD_NOT_FOUND,
    NOT_PERMITTED, RejectReason, RpcError, TransmitRecord,
};
use ecan_service_zenoh::{
    BatchHead, FrameAccount, Keys, Publication, PublicationConfig, PublicationError,
    PublicationEvent,
};
use serde_json::{Value, json};
use zenoh::handlers::FifoChannelHandler;
use zenoh::pubsub::Subscriber;
use zenoh::query::Reply;
use zenoh::sample::Sample;
use zenoh::{Config, Session, Wait as _};

use common::{Fixture, PATIENCE, frame, wait_for};

const PREFIX: &str = "bench/cell/master0";

type Samples = Subscriber<FifoChannelHandler<Sample>>;

/// A publication on a thread of its own, and a session of another host.
struct Published {
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<Result<(), PublicationError>>>,
    remote: Session,
    events: Receiver<PublicationEvent>,
}

fn write_config(directory: &Path, text: &str) -> std::path::PathBuf {
    let path = directory.join("zenoh.json5");
    std::fs::write(&path, text).unwrap();
    path
}

fn config(has_control: bool) -> PublicationConfig {
    let keys = Keys::new(PREFIX).unwrap();
    PublicationConfig { keys, has_control, interval: Duration::from_millis(50) }
}

/// Publishes to a session that connects to the publisher.
fn publish(fixture: &Fixture, has_control: bool) -> Published {
    let address = free_address("tcp");
    let remote = || open_remote(&address, "").unwrap();
    publish_by(fixture, has_control, &format!("listen: {}", endpoints(&address)), remote)
}

fn endpoints(address: &str) -> String {
    format!("{{ endpoints: ['{address}'] }}")
}

/// An address of this host that was free a moment ago.
fn free_address(protocol: &str) -> String {
    let address = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap();
    format!("{protocol}/{address}")
}

fn open_remote(address: &str, settings: &str) -> zenoh::Result<Session> {
    open_session(&format!("mode: 'client', connect: {}, {settings}", endpoints(address)))
}

fn open_session(settings: &str) -> zenoh::Result<Session> {
    let text = format!("{{ scouting: {{ multicast: {{ enabled: false }} }}, {settings} }}");
    zenoh::open(Config::from_json5(&text)?).wait()
}

/// Publishes with these settings of Zenoh to a session that is opened afterwards.
fn publish_by(
    fixture: &Fixture,
    has_control: bool,
    settings: &str,
    open_remote: impl FnOnce() -> Session,
) -> Published {
    let file = write_config(fixture.directory.path(), &format!("{{ {settings} }}"));
    let publication = Publication::open(&file, config(has_control)).unwrap();
    let (stop, socket) = (Arc::new(AtomicBool::new(false)), fixture.path());
    let is_stopped = stop.clone();
    let (events, received) = channel();
    let thread = std::thread::spawn(move || {
        let report = |event| drop(events.send(event));
        publication.run(&socket, &|| is_stopped.load(Ordering::Acquire), &report)
    });
    let remote = open_remote();
    let published = Published { stop, thread: Some(thread), remote, events: received };
    wait_for("the token", || published.is_alive());
    published
}

impl Published {
    fn is_alive(&self) -> bool {
        let replies = self.remote.liveliness().get(key("alive/*")).wait().unwrap();
        replies.recv().is_ok()
    }

    fn subscribe(&self, selector: &str) -> Samples {
        self.remote.declare_subscriber(key(selector)).wait().unwrap()
    }

    fn replies(&self, selector: &str, payload: Vec<u8>) -> Vec<Reply> {
        let replies = self.remote.get(key(selector)).payload(payload).timeout(PATIENCE).wait();
        replies.unwrap().into_iter().collect()
    }

    /// The only reply.
    fn get(&self, selector: &str, payload: Vec<u8>) -> Result<Sample, RpcError> {
        let mut replies = self.replies(selector, payload);
        assert_eq!(replies.len(), 1, "{selector}: {replies:?}");
        replies.remove(0).into_result().map_err(|error| {
            serde_json::from_slice(&error.payload().to_bytes()).expect("an RpcError")
        })
    }

    fn call(&self, method: &str, params: Value) -> Result<Value, RpcError> {
        let sample = self.get(method, params.to_string().into_bytes())?;
        Ok(serde_json::from_slice(&sample.payload().to_bytes()).unwrap())
    }

    fn send(&self, records: &[TransmitRecord]) -> Result<Vec<FrameReport>, RpcError> {
        let mut payload = Vec::new();
        records.iter().for_each(|record| record.encode(&mut payload));
        self.get("send", payload).map(|it| reports(&it))
    }

    fn end(mut self) -> Result<(), PublicationError> {
        self.stop.store(true, Ordering::Release);
        self.thread.take().unwrap().join().unwrap()
    }
}

fn key(rest: &str) -> String {
    format!("{PREFIX}/{rest}")
}

fn head(sample: &Sample) -> BatchHead {
    BatchHead::decode(&sample.attachment().expect("a head").to_bytes()).unwrap()
}

fn reports(sample: &Sample) -> Vec<FrameReport> {
    let record = |record| match record {
        Ok(FrameRecord::Frame(report)) => report,
        other => panic!("{other:?}"),
    };
    FrameRecords::new(&sample.payload().to_bytes()).map(record).collect()
}

fn next(samples: &Samples) -> Sample {
    samples.recv_timeout(PATIENCE).unwrap().expect("a sample")
}

fn record(channel: u8, tag: u32, data: &[u8]) -> TransmitRecord {
    TransmitRecord { gateway: 0, channel, tag, max_age_ms: 0, frame: frame(0x123, data) }
}

#[test]
fn frames_arrive_by_channel_and_all_are_counted() {
    let fixture = Fixture::start(|_| ());
    let published = publish(&fixture, false);
    let samples = published.subscribe("frames/*/*");
    fixture.frames_per_cycle.store(3, Ordering::Release);
    let mut account = FrameAccount::default();
    let mut events = Vec::new();
    let mut take = |sample: Sample, account: &mut FrameAccount| {
        let batch = reports(&sample);
        let (own, channel) = (sample.key_expr().as_str(), key("frames/0/0"));
        assert!(own == channel && batch.iter().all(|it| it.channel == 0), "{own}");
        account.take(head(&sample), batch.len() as u64);
        events.extend(batch.iter().map(|it| it.event));
    };
    while account.received() < 1000 {
        take(next(&samples), &mut account);
    }
    fixture.frames_per_cycle.store(0, Ordering::Release);
    // Until the last frame that the service delivered to the publisher.
    let delivered = || {
        let clients = fixture.client().service_stats().unwrap().clients;
        let client = clients.into_iter().find(|it| it.name == "ecan zenoh: frames").unwrap();
        (client.frames_delivered, client.frames_lost)
    };
    let mut before = delivered();
    wait_for("the end of the frames", || {
        std::thread::sleep(Duration::from_millis(50));
        std::mem::replace(&mut before, delivered()) == before
    });
    let present = || head(&published.get("frames/0/0", Vec::new()).unwrap());
    wait_for("the publication of all", || present().frames == before.0);
    let present = present();
    account.take(present, 0);
    while account.lost_on_network() > 0 {
        take(next(&samples), &mut account);
    }
    assert_eq!((account.lost_in_service(), present.lost), (0, before.1));
    assert!(events.contains(&FrameEvent::Received) && events.contains(&FrameEvent::Transmitted));
    assert_eq!(published.replies("frames/*/*", Vec::new()).len(), 2, "both channels");
    published.end().unwrap();
}

#[test]
fn states_are_published_and_answer_to_get() {
    let fixture = Fixture::start(|_| ());
    let published = publish(&fixture, false);
    let states = published.subscribe("state");
    let state: Value = serde_json::from_slice(&next(&states).payload().to_bytes()).unwrap();
    assert_eq!(state["gateways"][0]["session"], "ready");
    let state = published.call("state", json!({})).unwrap();
    assert!(state["cycle"]["cycle"].as_u64().unwrap() > 0, "{state}");
    assert_eq!(published.call("hello", json!({})).unwrap()["access"], "read");
    let all = published.remote.get("bench/**").timeout(PATIENCE).wait().unwrap();
    let mut names: Vec<_> = all
        .into_iter()
        .map(|it| it.into_result().unwrap().key_expr().as_str().replace(&key(""), ""))
        .collect();
    names.sort();
    let expected =
        ["axes", "bus.state", "frames/0/0", "frames/0/1", "hello", "service.stats", "state"];
    assert_eq!(names, expected);
    published.end().unwrap();
}

#[test]
fn objects_are_read_and_failures_have_their_data() {
    let fixture = Fixture::start(|_| ());
    let published = publish(&fixture, false);
    let object = |index: u32| json!({ "slave": 0, "index": index, "subindex": 0 });
    let upload = published.call("sdo.upload", object(0x1000)).unwrap();
    assert_eq!(upload["data"].as_str().map(str::len), Some(8), "{upload}");
    let error = published.call("sdo.upload", object(0x5fff)).unwrap_err();
    assert_eq!((error.code, error.data["kind"].as_str()), (BUS_ERROR, Some("sdo")));
    let error = published.call("frames.subscribe", json!({})).unwrap_err();
    assert_eq!(error.code, METHOD_NOT_FOUND);
    published.end().unwrap();
}

#[test]
fn frames_are_sent_with_their_results_in_the_reply() {
    let fixture = Fixture::start(|_| ());
    let published = publish(&fixture, true);
    let samples = published.subscribe("frames/0/0");
    let records = [record(0, 7, &[1]), record(3, 8, &[2]), record(0, 9, &[3])];
    let results = published.send(&records).unwrap();
    let results: Vec<_> = results.iter().map(|it| (it.tag, it.event, it.frame)).collect();
    let no_channel = FrameEvent::Rejected(RejectReason::NoSuchChannel);
    let events = [FrameEvent::Transmitted, no_channel, FrameEvent::Transmitted];
    let expected: Vec<_> =
        records.iter().zip(events).map(|(it, event)| (it.tag, event, it.frame)).collect();
    assert_eq!(results, expected);
    let mut seen = Vec::new();
    while seen.len() < 4 {
        seen.extend(reports(&next(&samples)));
    }
    assert!(seen.iter().all(|it| it.tag == 0), "tags are those of their sender: {seen:?}");

    let error = published.get("send", vec![0; 15]).unwrap_err();
    assert_eq!(error.code, BAD_RECORD);
    assert_eq!(published.send(&[]).unwrap(), []);
    let nmt = json!({ "gateway": 0, "channel": 0, "node": 1, "command": "start" });
    published.call("nmt", nmt).unwrap();
    let heartbeat = json!({ "slave": 0, "index": 0x1000, "subindex": 0, "data": "00" });
    assert_eq!(published.call("sdo.download", heartbeat).unwrap_err().code, BUS_ERROR);
    published.end().unwrap();
}

#[test]
fn control_needs_the_option_and_the_service() {
    let nmt = json!({ "gateway": 0, "channel": 0, "node": 0, "command": "start" });
    let fixture = Fixture::start(|_| ());
    let published = publish(&fixture, false);
    for error in [
        published.send(&[record(0, 1, &[])]).unwrap_err(),
        published.call("nmt", nmt.clone()).unwrap_err(),
        published.call("sim.fault", json!({})).unwrap_err(),
    ] {
        assert_eq!(error.code, NOT_PERMITTED);
        assert!(error.message.contains("start ecan zenoh with --control"), "{error}");
    }
    published.end().unwrap();
    let fixture = Fixture::start(|config| config.control = Control::Nobody);
    let published = publish(&fixture, true);
    for error in
        [published.send(&[record(0, 1, &[])]).unwrap_err(), published.call("nmt", nmt).unwrap_err()]
    {
        assert_eq!(error.code, NOT_PERMITTED);
        assert!(error.message.contains("read-only"), "{error}");
    }
    published.end().unwrap();
}

#[test]
fn end_of_the_service_ends_the_run_and_the_token() {
    let mut fixture = Fixture::start(|_| ());
    let mut published = publish(&fixture, false);
    fixture.stop();
    let error = published.thread.take().unwrap().join().unwrap().unwrap_err();
    assert!(matches!(error, PublicationError::Service(_)), "{error}");
    wait_for("the end of the token", || !published.is_alive());
}

#[test]
fn second_publisher_with_the_same_prefix_is_reported() {
    let fixture = Fixture::start(|_| ());
    let published = publish(&fixture, false);
    let token = key("alive/other");
    let _token = published.remote.liveliness().declare_token(&token).wait().unwrap();
    let reported = || published.events.recv_timeout(PATIENCE).unwrap();
    let warning = std::iter::repeat_with(reported)
        .find(|it| *it == PublicationEvent::PrefixInUse { token: token.clone() });
    assert!(warning.unwrap().to_string().contains("set --prefix"));
    published.end().unwrap();
}

#[test]
fn access_control_of_zenoh_applies() {
    let fixture = Fixture::start(|_| ());
    let access = "access_control: { enabled: true, default_permission: 'allow',
        rules: [{ id: 'no-sdo', permission: 'deny', flows: ['ingress'],
                  messages: ['query'], key_exprs: ['**/sdo.upload'] }],
        subjects: [{ id: 'all' }],
        policies: [{ rules: ['no-sdo'], subjects: ['all'] }] }";
    let address = free_address("tcp");
    let settings = format!("listen: {}, {access}", endpoints(&address));
    let remote = || open_remote(&address, "").unwrap();
    let published = publish_by(&fixture, true, &settings, remote);
    assert!(published.call("state", json!({})).is_ok());
    let object = json!({ "slave": 0, "index": 0x1000, "subindex": 0 });
    assert!(published.replies("sdo.upload", object.to_string().into_bytes()).is_empty());
    published.end().unwrap();
}

/// Makes a certificate authority, and a certificate of both hosts.
fn make_certificates(directory: &Path) -> bool {
    let script = "
        openssl req -x509 -newkey ec -pkeyopt ec_paramgen_curve:P-256 -nodes -days 2 \
            -subj /CN=authority -keyout ca.key -out ca.pem &&
        openssl req -newkey ec -pkeyopt ec_paramgen_curve:P-256 -nodes \
            -subj /CN=host -keyout host.key -out host.csr &&
        echo subjectAltName=IP:127.0.0.1 >extensions &&
        openssl x509 -req -in host.csr -CA ca.pem -CAkey ca.key -CAcreateserial -days 2 \
            -extfile extensions -out host.pem";
    let output = Command::new("sh").args(["-c", script]).current_dir(directory).output().unwrap();
    // 127: not found.
    let is_made = output.status.code() != Some(127);
    assert!(output.status.success() || !is_made, "{}", String::from_utf8_lossy(&output.stderr));
    is_made
}

#[test]
fn encrypted_link_needs_a_certificate() {
    let fixture = Fixture::start(|_| ());
    let directory = fixture.directory.path();
    if !make_certificates(directory) {
        return println!("skipped: no openssl");
    }
    let directory = directory.display();
    let authority = format!("root_ca_certificate: '{directory}/ca.pem'");
    let tls = |settings: &str| format!("transport: {{ link: {{ tls: {{ {settings} }} }} }}");
    let certificate = |end: &str| {
        format!(
            "{end}_private_key: '{directory}/host.key', {end}_certificate: '{directory}/host.pem'"
        )
    };
    let address = free_address("tls");
    let listen = tls(&format!("enable_mtls: true, {authority}, {}", certificate("listen")));
    let connect = tls(&format!("enable_mtls: true, {authority}, {}", certificate("connect")));
    let settings = format!("listen: {}, {listen}", endpoints(&address));
    let published = publish_by(&fixture, false, &settings, || {
        assert!(open_remote(&address, "").is_err(), "without the authority");
        assert!(open_remote(&address, &tls(&authority)).is_err(), "without a certificate");
        open_remote(&address, &connect).unwrap()
    });
    assert!(published.call("state", json!({})).is_ok());
    published.end().unwrap();
}

#[test]
fn router_between_the_hosts_forwards() {
    let fixture = Fixture::start(|_| ());
    let address = free_address("tcp");
    let router = format!("mode: 'router', listen: {}", endpoints(&address));
    let _router = open_session(&router).unwrap();
    let settings = format!("mode: 'client', connect: {}", endpoints(&address));
    let remote = || open_remote(&address, "").unwrap();
    let published = publish_by(&fixture, true, &settings, remote);
    let links = published.events.recv_timeout(PATIENCE).unwrap();
    assert_eq!(links, PublicationEvent::Links { routers: 1, peers: 0 });
    let samples = published.subscribe("frames/0/0");
    let sent = published.send(&[record(0, 1, &[5])]).unwrap();
    assert_eq!(sent[0].event, FrameEvent::Transmitted);
    wait_for("a frame", || {
        published.send(&[record(0, 1, &[6])]).unwrap();
        samples.try_recv().unwrap().is_some_and(|it| !reports(&it).is_empty())
    });
    published.end().unwrap();
}

#[test]
fn unreachable_router_is_reported() {
    let directory = tempfile::tempdir().unwrap();
    let free = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap();
    let text = format!("{{ mode: 'client', connect: {{ endpoints: ['tcp/{free}'] }} }}");
    let error = Publication::open(&write_config(directory.path(), &text), config(false));
    let error = error.unwrap_err().to_string();
    assert!(error.contains("cannot open the Zenoh session"), "{error}");
    assert!(error.contains(&free.to_string()), "{error}");
}
