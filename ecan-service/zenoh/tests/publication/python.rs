//! The client in Python of the examples, and publishers that are not of this project.

use std::io::Write as _;
use std::process::{Command, Output, Stdio};
use std::sync::mpsc::channel;

use ecan_service_zenoh::{BatchHead, PublisherInfo};
use serde_json::json;
use zenoh::{Session, Wait as _};

use crate::common::{Fixture, PATIENCE, frame};
use crate::session::{
    PREFIX, config, endpoints, free_address, key, open_session, publish, publish_by,
};
use ecan_test_support::Killed;

const SCRIPT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../examples/python/zenoh_client.py");

/// A router on this host and the client in Python.
struct Peer {
    directory: tempfile::TempDir,
    interpreter: String,
    address: String,
    _router: Session,
}

impl Peer {
    /// `None` without the package; ECAN_PYTHON names the interpreter, which then must have it.
    fn start() -> Option<Self> {
        let named = std::env::var("ECAN_PYTHON").ok().filter(|value| !value.is_empty());
        let interpreter = named.clone().unwrap_or_else(|| "python3".to_owned());
        let imported = Command::new(&interpreter).args(["-c", "import zenoh"]).output();
        let is_there = imported.is_ok_and(|output| output.status.success());
        assert!(is_there || named.is_none(), "{interpreter} has no eclipse-zenoh");
        if !is_there {
            let _ = writeln!(std::io::stderr(), "skipped: {interpreter} has no eclipse-zenoh");
            return None;
        }
        let address = free_address("tcp");
        let router = format!("mode: 'router', listen: {}", endpoints(&address));
        let _router = open_session(&router).unwrap();
        let directory = tempfile::tempdir().unwrap();
        let text = format!(
            "{{ mode: 'client', scouting: {{ multicast: {{ enabled: false }} }}, connect: {} }}",
            endpoints(&address)
        );
        std::fs::write(directory.path().join("peer.json5"), text).unwrap();
        Some(Self { directory, interpreter, address, _router })
    }

    fn settings(&self) -> String {
        format!("mode: 'client', connect: {}", endpoints(&self.address))
    }

    fn spawn(&self, prefix: &str, rest: &[&str]) -> Killed {
        Killed::spawn(
            Command::new(&self.interpreter)
                .args(["-B", SCRIPT])
                .arg(self.directory.path().join("peer.json5"))
                .arg(prefix)
                .args(rest)
                .env("ECAN_CLIENT", "python")
                .stdout(Stdio::piped())
                .stderr(Stdio::piped()),
        )
    }

    fn run(&self, prefix: &str, rest: &[&str]) -> Output {
        self.spawn(prefix, rest).output()
    }

    /// Message of a run that fails.
    fn fails(&self, status: i32, prefix: &str, rest: &[&str]) -> String {
        let output = self.run(prefix, rest);
        let errors = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(status), "{rest:?}: {errors}");
        assert!(!errors.contains("Traceback"), "{errors}");
        errors
    }

    fn open(&self) -> Session {
        open_session(&self.settings()).unwrap()
    }
}

#[test]
fn python_client_fails_unless_the_frame_was_sent() {
    let Some(peer) = Peer::start() else { return };
    for rest in [&["send", "0", "0", "123#11"][..], &["state"], &[]] {
        let message = peer.fails(1, PREFIX, rest);
        assert!(
            message.contains(&format!("no answer from {PREFIX}: check the prefix")),
            "{message}"
        );
    }
    let fixture = Fixture::start(|_| ());
    let remote = || peer.open();
    let settings = peer.settings();
    let published = publish_by(&fixture, &fixture.path(), config(true), &settings, remote);
    let output = peer.run(PREFIX, &["send", "0", "0", "123#1122"]);
    let text = String::from_utf8(output.stdout).unwrap();
    assert!(output.status.success() && text.contains(" 0.0 transmitted 123 [2] 1122"), "{text}");
    let output = peer.run(PREFIX, &["send", "0", "can1", "123#0102", "extended", "brs"]);
    let text = String::from_utf8(output.stdout).unwrap();
    assert!(text.contains(" 0.1 transmitted 00000123 [2] 0102 fd brs"), "{text}");
    let message = peer.fails(2, PREFIX, &["send", "0", "0", "123#", "fast"]);
    assert!(message.contains("frame kind fast is not known; allowed: extended"), "{message}");
    let message = peer.fails(1, PREFIX, &["send", "0", "3", "123#1122"]);
    assert!(message.contains("frame 123 rejected: no such channel"), "{message}");
    let message = peer.fails(1, PREFIX, &["no.method", "{}"]);
    assert!(message.contains("method no.method does not exist"), "{message}");
    let message = peer.fails(1, "bench/other/master0", &["state"]);
    assert!(message.contains("no answer from bench/other/master0: check the prefix"), "{message}");
    assert!(peer.run(PREFIX, &["state"]).status.success());
    for rest in [&["send", "0"][..], &["send", "0", "0", "xyz"]] {
        peer.fails(2, PREFIX, rest);
    }
    published.end().unwrap();
    peer.fails(1, PREFIX, &["send", "0", "0", "123#1122"]);
    let read_only = publish(&fixture, false);
    drop(read_only);
    let published = publish_by(&fixture, &fixture.path(), config(false), &settings, remote);
    let message = peer.fails(1, PREFIX, &["send", "0", "0", "123#1122"]);
    assert!(message.contains("start ecan zenoh with --control"), "{message}");
    published.end().unwrap();
}

#[test]
fn python_client_rejects_two_publishers() {
    let Some(peer) = Peer::start() else { return };
    let fixtures = [Fixture::start(|_| ()), Fixture::start(|_| ())];
    let start = |fixture: &Fixture| {
        publish_by(fixture, &fixture.path(), config(true), &peer.settings(), || peer.open())
    };
    let _publications = fixtures.each_ref().map(start);
    for rest in [&["send", "0", "0", "123#11"][..], &["state"], &[]] {
        let message = peer.fails(1, PREFIX, rest);
        assert!(message.contains(&format!("2 publishers use {PREFIX}")), "{message}");
    }
    for fixture in &fixtures {
        assert_eq!(crate::session::sent_frames(fixture), 0);
    }
}

#[test]
fn python_client_counts_losses_over_a_restart() {
    let Some(peer) = Peer::start() else { return };
    let session = peer.open();
    let info = json!(PublisherInfo {
        publisher: "1f".into(),
        now_ns: 5,
        max_lifetime_ms: 10_000,
        epoch: 1,
        access: Default::default(),
        access_reason: None,
    });
    let name = key("publisher/1f");
    let last = BatchHead { epoch: 2, connections: 2, frames: 9, lost: 3 };
    let (asked, questions) = channel();
    let _publisher = session
        .declare_queryable(key("**"))
        .callback(move |query| {
            if query.key_expr().as_str() == key("publisher/*") {
                query.reply(&name, info.to_string()).wait().unwrap();
            } else {
                let reply = query.reply(key("frames/0/0"), Vec::new());
                reply.attachment(last.encode()).wait().unwrap();
            }
            let _ = asked.send(());
        })
        .wait()
        .unwrap();
    let frames = session.declare_publisher(key("frames/0/0")).wait().unwrap();
    let mut child = peer.spawn(PREFIX, &[]);
    questions.recv_timeout(PATIENCE).unwrap();
    crate::common::wait_for("the subscriber", || {
        frames.matching_status().wait().is_ok_and(|status| status.matching())
    });
    let mut records = Vec::new();
    ecan_service::client::FrameReport {
        time_ns: 1,
        gateway: 0,
        channel: 0,
        tag: 0,
        event: ecan_service::client::FrameEvent::Received,
        frame: frame(0x123, &[]),
    }
    .encode(&mut records);
    // One received of 2 after the first sample; 5 lost before the first sample of the second start,
    // and 2 lost at the end.
    for (epoch, before) in [(1, 100), (1, 102), (2, 5), (2, 6)] {
        let head = BatchHead { epoch, connections: 1, frames: before, lost: 0 };
        frames.put(records.clone()).attachment(head.encode()).wait().unwrap();
    }
    // Until all have been printed.
    let mut lines = child.lines();
    assert_eq!(lines.by_ref().filter(|line| line.contains(" received ")).take(4).count(), 4);
    let kill = Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap();
    assert!(kill.success());
    let rest: String = lines.collect();
    let output = child.output();
    let errors = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.success(), "{errors}");
    assert!(rest.contains("4 received, 8 lost, 3 lost in the service"), "{rest}");
    assert!(errors.contains("started again 1 times, connected again 1 times"), "{errors}");
}
