//! Clients that are not the project's and claim more than their share.

use std::io::Write as _;
use std::os::unix::fs::PermissionsExt as _;
use std::os::unix::net::UnixStream;
use std::process::{Command, Stdio};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use super::common::{Fixture, call, exists, read, say_hello, wait_for, write};
use ecan_service::client::*;
use ecan_service::server::{Control, Extension, Permission};
use ecan_sim::{Fault, GatewayFault};
use ecan_test_support::Killed;
use serde_json::{Value, json};

/// Longer than any test.
const SILENCE_MS: u32 = 3_600_000;

/// A service with a gateway whose mailbox does not respond.
fn with_silent_mailbox() -> Fixture {
    let fixture = Fixture::start(|_| ());
    let fault = GatewayFault::MailboxSilent { ms: SILENCE_MS };
    fixture.simulation.inject(Fault::Gateway { gateway: 0, fault });
    fixture
}

fn request(id: u64, method: &str, params: Value) -> Vec<u8> {
    let request = json!({"jsonrpc": "2.0", "id": id, "method": method, "params": params});
    request.to_string().into_bytes()
}

fn upload(id: u64, once: bool) -> Vec<u8> {
    let params = json!({"slave": 0, "index": 0x8001, "subindex": 19, "once": once});
    request(id, "sdo.upload", params)
}

/// A connection that sends a hello and requests, and reads nothing.
fn send_blindly(fixture: &Fixture, requests: impl Iterator<Item = Vec<u8>>) -> UnixStream {
    let mut stream = fixture.stream();
    let hello = request(0, "hello", json!({"version": 1, "client": "attacker"}));
    write(&mut stream, MessageKind::Rpc, &hello);
    requests.for_each(|request| write(&mut stream, MessageKind::Rpc, &request));
    stream
}

fn error_of(response: &[u8]) -> RpcError {
    serde_json::from_slice::<Response>(response).unwrap().error.unwrap()
}

/// Each upload needs 5 s: one after the other they would need minutes.
#[test]
fn requests_of_clients_that_left_are_not_executed() {
    let fixture = with_silent_mailbox();
    let good = fixture.client();
    for _ in 0..100 {
        drop(send_blindly(&fixture, (1..=16).map(|id| upload(id, false))));
    }
    assert_eq!(good.bus_state().unwrap().slaves_responding, 1);
    wait_for("the end of the others", || good.service_stats().unwrap().clients.len() == 1);
    let stats = good.service_stats().unwrap();
    assert!(stats.requests_pending <= 1, "one transfer per slave: {stats:?}");
    assert!(stats.requests_cancelled >= 1000, "{stats:?}");
}

#[test]
fn thousands_of_connections_leave_nothing_behind() {
    let fixture = Fixture::start(|config| config.control = Control::Nobody);
    let fault = GatewayFault::MailboxSilent { ms: SILENCE_MS };
    fixture.simulation.inject(Fault::Gateway { gateway: 0, fault });
    let good = fixture.client();
    for round in 0..20 {
        for _ in 0..100 {
            drop(send_blindly(&fixture, (1..=16).map(|id| upload(id, false))));
        }
        let stats = good.service_stats().unwrap();
        assert!(stats.requests_pending <= 64, "round {round}: {stats:?}");
    }
    wait_for("the end of the others", || good.service_stats().unwrap().clients.len() == 1);
    assert!(good.service_stats().unwrap().requests_pending <= 1);
}

#[test]
fn one_client_with_many_uploads_leaves_turns_to_others() {
    let fixture = with_silent_mailbox();
    let good = fixture.client();
    let mut greedy = send_blindly(&fixture, (1..=16).map(|id| upload(id, true)));
    wait_for("its uploads", || good.service_stats().unwrap().requests_pending == 16);
    assert_eq!(good.slaves().unwrap().len(), 1);
    let params =
        UploadParams { slave: 0, index: 0x8001, subindex: 19, max_bytes: None, once: true };
    assert_eq!(good.sdo_upload(&params).unwrap_err().rpc().unwrap().code, BUS_ERROR);
    // It waited for one transfer of the other client, or two.
    let pending = good.service_stats().unwrap().requests_pending;
    assert!(pending > 8, "{pending}");
    // A further request of the greedy client exceeds its own limit only.
    write(&mut greedy, MessageKind::Rpc, &upload(17, true));
    (17..40).for_each(|id| write(&mut greedy, MessageKind::Rpc, &upload(id, true)));
    wait_for("a rejection", || {
        let stats = good.service_stats().unwrap();
        stats.requests_rejected > 0
            && stats.clients.iter().any(|client| client.requests_rejected > 0)
    });
}

/// Method `test.hold`, which blocks until the test releases it, and `test.count`.
#[derive(Debug)]
struct Hold {
    started: Sender<()>,
    release: Mutex<Receiver<()>>,
    executed: Arc<AtomicU64>,
}

impl Extension for Hold {
    fn access(&self, method: &str) -> Option<Access> {
        ["test.hold", "test.count"].contains(&method).then_some(Access::Control)
    }

    fn call(&self, method: &str, _: &Value, _: &Permission) -> Option<Result<Value, RpcError>> {
        if method == "test.hold" {
            let _ = self.started.send(());
            let _ = self.release.lock().unwrap().recv_timeout(super::common::PATIENCE);
        } else {
            self.executed.fetch_add(1, Ordering::Release);
        }
        Some(Ok(Value::Null))
    }
}

struct Held {
    fixture: Fixture,
    started: Receiver<()>,
    release: Sender<()>,
    executed: Arc<AtomicU64>,
}

fn held() -> Held {
    let (started_sender, started) = channel();
    let (release, released) = channel();
    let executed = Arc::new(AtomicU64::new(0));
    let hold =
        Hold { started: started_sender, release: Mutex::new(released), executed: executed.clone() };
    let fixture = Fixture::start(|config| config.extensions.push(Arc::new(hold)));
    Held { fixture, started, release, executed }
}

#[test]
fn request_older_than_its_limit_is_not_executed() {
    let Held { fixture, started, release, executed } = held();
    let mut stream = fixture.stream();
    say_hello(&mut stream);
    write(&mut stream, MessageKind::Rpc, &request(1, "test.hold", json!({})));
    started.recv_timeout(super::common::PATIENCE).unwrap();
    for (id, max_age_ms) in [(2, 3_600_000), (3, 1)] {
        let request =
            json!({"jsonrpc": "2.0", "id": id, "method": "test.count", "max_age_ms": max_age_ms});
        write(&mut stream, MessageKind::Rpc, request.to_string().as_bytes());
    }
    let good = fixture.client();
    // On a busy machine the second one expires before it waits.
    wait_for("the requests", || {
        let stats = good.service_stats().unwrap();
        stats.requests_pending + stats.requests_expired == 3
    });
    let queued = Instant::now();
    wait_for("their age", || queued.elapsed() > Duration::from_millis(5));
    release.send(()).unwrap();
    let mut codes: Vec<_> = (0..3)
        .map(|_| {
            let response: Response = serde_json::from_slice(&read(&mut stream).unwrap().1).unwrap();
            (response.id.unwrap().as_u64().unwrap(), response.error.map(|error| error.code))
        })
        .collect();
    codes.sort_unstable();
    assert_eq!(codes, [(1, None), (2, None), (3, Some(EXPIRED))]);
    assert_eq!(executed.load(Ordering::Acquire), 1);
    assert_eq!(good.service_stats().unwrap().requests_expired, 1);
}

#[test]
fn long_requests_are_limited_in_bytes() {
    let Held { fixture, started, release, .. } = held();
    let mut streams: Vec<_> = (0..4).map(|_| fixture.stream()).collect();
    let long = |id| request(id, "test.hold", json!({"text": "x".repeat(1_000_000)}));
    for stream in &mut streams {
        say_hello(stream);
        (1..=3).for_each(|id| write(stream, MessageKind::Rpc, &long(id)));
    }
    started.recv_timeout(super::common::PATIENCE).unwrap();
    let good = fixture.client();
    // Two of each client, and four of the user.
    wait_for("the rejections", || good.service_stats().unwrap().requests_rejected == 8);
    assert_eq!(good.service_stats().unwrap().requests_pending, 4);
    let (_, answer) = read(&mut streams[3]).unwrap();
    let error = error_of(&answer);
    assert_eq!((error.code, &error.data["limit"]), (BUSY, &json!("user")), "{error}");
    assert_eq!(good.bus_state().unwrap().slaves_responding, 1);
    drop(release);
}

#[test]
fn long_requests_need_control_and_a_method_of_the_program() {
    let Held { fixture, .. } = held();
    let long = "x".repeat(MAX_METHOD_PAYLOAD);
    let mut stream = fixture.stream();
    say_hello(&mut stream);
    let state = json!({"jsonrpc": "2.0", "id": 1, "method": "sdo.upload", "params": {"a": long}});
    assert_eq!(call(&mut stream, &state).error.unwrap().code, INVALID_REQUEST);
    // Before the hello.
    let mut stream = fixture.stream();
    stream.write_all(&header(MessageKind::Rpc, MAX_HELLO_PAYLOAD + 1)).unwrap();
    let (_, answer) = read(&mut stream).unwrap();
    assert_eq!(error_of(&answer).code, INVALID_REQUEST);
    assert!(read(&mut stream).is_none());
    drop(fixture);
    let fixture = Fixture::start(|config| config.control = Control::Nobody);
    let mut stream = fixture.stream();
    say_hello(&mut stream);
    stream.write_all(&header(MessageKind::Rpc, MAX_METHOD_PAYLOAD + 1)).unwrap();
    let (_, answer) = read(&mut stream).unwrap();
    assert!(error_of(&answer).message.contains("allowed: at most 65536 bytes"));
}

#[test]
fn wrong_parameters_take_no_place_in_a_queue() {
    let fixture = with_silent_mailbox();
    let good = fixture.client();
    let _busy = send_blindly(&fixture, (1..=4).map(|id| upload(id, false)));
    wait_for("the uploads", || good.service_stats().unwrap().requests_pending == 4);
    let mut stream = fixture.stream();
    say_hello(&mut stream);
    let data = "00".repeat(MAX_SDO_BYTES as usize + 1);
    for (method, params, code) in [
        (
            "sdo.upload",
            json!({"slave": 0, "index": 1, "subindex": 0, "max_bytes": 0}),
            INVALID_PARAMS,
        ),
        (
            "sdo.download",
            json!({"slave": 0, "index": 1, "subindex": 0, "data": data}),
            INVALID_PARAMS,
        ),
        ("sdo.upload", json!({"slave": 0}), INVALID_PARAMS),
        ("no.such\u{1b}[31m", json!({}), METHOD_NOT_FOUND),
    ] {
        let response = serde_json::from_slice(&request(9, method, params)).unwrap();
        let error = call(&mut stream, &response).error.unwrap();
        assert_eq!(error.code, code, "{error}");
        assert!(!error.message.contains('\u{1b}'));
    }
    assert_eq!(good.service_stats().unwrap().requests_pending, 4);
}

#[test]
fn long_lists_of_a_subscription_are_rejected() {
    let fixture = Fixture::start(|_| ());
    let mut stream = fixture.stream();
    say_hello(&mut stream);
    let filters: Vec<_> = (0..=256).map(|id| json!({"id": id, "mask": 2047})).collect();
    for (params, text) in [
        (json!({"filters": filters}), "filters: more than 256 entries"),
        (json!({"channels": [0, 1, 4]}), "channels: 4 is out of range; allowed: 0 to 3"),
        (json!({"gateways": [7, 7]}), "gateways: 7 is in the list twice"),
    ] {
        let subscribe =
            json!({"jsonrpc": "2.0", "id": 1, "method": "frames.subscribe", "params": params});
        let error = call(&mut stream, &subscribe).error.unwrap();
        assert_eq!(error.code, INVALID_PARAMS);
        assert!(error.message.contains(text), "{error}");
    }
    // Within the limit.
    let params = json!({"filters": filters[1..], "channels": [0, 1, 2, 3]});
    let subscribe =
        json!({"jsonrpc": "2.0", "id": 1, "method": "frames.subscribe", "params": params});
    assert!(call(&mut stream, &subscribe).error.is_none());
    let gateways: Vec<_> = std::iter::repeat_n(0, 500_000).collect();
    let params = json!({"gateways": gateways});
    let subscribe =
        json!({"jsonrpc": "2.0", "id": 1, "method": "frames.subscribe", "params": params});
    assert_eq!(call(&mut stream, &subscribe).error.unwrap().code, INVALID_REQUEST);
}

#[test]
fn name_of_a_client_is_cut_and_cleaned() {
    let fixture = Fixture::start(|_| ());
    let good = fixture.client();
    let mut stream = fixture.stream();
    let name = format!("evil\u{1b}[2J\n\u{202e}{}", "é".repeat(500));
    let params = json!({"version": 1, "client": name});
    let hello = json!({"jsonrpc": "2.0", "id": 1, "method": "hello", "params": params});
    assert!(call(&mut stream, &hello).result.is_some());
    let stats = good.service_stats().unwrap();
    let name = &stats.clients.last().unwrap().name;
    assert!(name.starts_with("evil?[2J??é") && name.len() <= 64, "{name}");
}

#[test]
fn clients_without_hello_are_ended() {
    let fixture = Fixture::start(|config| config.max_clients = 4);
    let good = fixture.client();
    wait_for("the places", || good.service_stats().unwrap().clients.len() == 1);
    let mut silent: Vec<_> = (0..3).map(|_| fixture.stream()).collect();
    wait_for("the connections", || good.service_stats().unwrap().clients.len() == 4);
    let error = Client::connect(&fixture.path(), "late").unwrap_err();
    assert_eq!(error.rpc().map(|error| error.code), Some(BUSY), "{error}");
    wait_for("a free place", || Client::connect(&fixture.path(), "late").is_ok());
    for stream in &mut silent {
        let (_, answer) = read(stream).unwrap();
        assert!(error_of(&answer).message.starts_with("no hello within 5 s"));
        assert!(read(stream).is_none());
    }
    assert_eq!(good.service_stats().unwrap().clients_silent, 3);
}

/// Connects as another user until the service rejects a connection; prints the number before.
const CROWD: &str = r#"
import os, socket, struct, sys
os.setuid(65534)
crowd = []
while True:
    client = socket.socket(socket.AF_UNIX)
    client.connect(sys.argv[1])
    hello = b'{"jsonrpc":"2.0","id":1,"method":"hello","params":{"version":1,"client":"crowd"}}'
    try:
        client.sendall(struct.pack("<IB3x", len(hello), 1) + hello)
    except BrokenPipeError:
        pass  # rejected before the hello; the reason has arrived
    answer = client.recv(65536)
    if b"allowed: 4, half of max_clients" in answer or len(crowd) > 9:
        break
    crowd.append(client)
print(len(crowd), flush=True)
sys.stdin.read()
"#;

#[test]
fn other_user_has_half_of_the_places() {
    if !rustix::process::geteuid().is_root() {
        return println!("skipped: needs root, to be another user");
    }
    if !Command::new("python3").arg("--version").output().is_ok_and(|out| out.status.success()) {
        return println!("skipped: no python3");
    }
    let fixture = Fixture::start(|config| (config.max_clients, config.mode) = (8, 0o666));
    let open = std::fs::Permissions::from_mode(0o711);
    std::fs::set_permissions(fixture.directory.path(), open).unwrap();
    assert!(exists(&fixture.path()));
    let mut child = Killed::spawn(
        Command::new("python3")
            .args(["-c", CROWD])
            .arg(fixture.path())
            .stdin(Stdio::piped())
            .stdout(Stdio::piped()),
    );
    assert_eq!(child.lines().next().as_deref(), Some("4"));
    assert!(Client::connect(&fixture.path(), "owner").is_ok());
}
