//! Encryption, authentication and access control of Zenoh.

use std::path::Path;
use std::process::Command;
use std::time::Duration;

use ecan_service::client::FrameEvent;
use serde_json::json;
use zenoh::{Config, Session, Wait as _};

use crate::common::{Fixture, PATIENCE, wait_for};
use crate::session::{
    Published, Remote, config, endpoints, free_address, key, next, open_remote, payload_of,
    publish, publish_by, publishers, record, reports, sent_frames,
};

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
    let published = publish_by(&fixture, &fixture.path(), config(true), &settings, remote);
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
    let published = publish_by(&fixture, &fixture.path(), config(false), &settings, || {
        assert!(open_remote(&address, "").is_err(), "without the authority");
        assert!(open_remote(&address, &tls(&authority)).is_err(), "without a certificate");
        open_remote(&address, &connect).unwrap()
    });
    assert!(published.call("state", json!({})).is_ok());
    published.end().unwrap();
}

#[test]
fn control_without_authentication_is_reported() {
    let fixture = Fixture::start(|_| ());
    let published = publish(&fixture, true);
    let reason = published.open_control.as_deref().unwrap_or_default();
    assert!(reason.contains("links without authentication"), "{reason}");
    assert!(reason.contains("access_control is off"), "{reason}");
    published.end().unwrap();
    assert_eq!(publish(&fixture, false).open_control, None, "remote clients only read");
}

const EXAMPLES: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../examples/zenoh");

/// The example with certificates in a folder and a router on this host.
struct Example {
    certificates: tempfile::TempDir,
    address: String,
}

impl Example {
    /// `None` without openssl.
    fn make() -> Option<Self> {
        if Command::new("openssl").arg("version").output().is_err() {
            println!("skipped: no openssl");
            return None;
        }
        let certificates = tempfile::tempdir().unwrap();
        let script = format!("{EXAMPLES}/make-certificates.sh");
        let arguments = ["IP:127.0.0.1", "stranger"];
        let output =
            Command::new(script).arg(certificates.path()).args(arguments).output().unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        Some(Self { certificates, address: free_address("tls") })
    }

    /// Text of a file of the example, for this host.
    fn text(&self, name: &str) -> String {
        let text = std::fs::read_to_string(format!("{EXAMPLES}/{name}.json5")).unwrap();
        let directory = self.certificates.path().display().to_string();
        text.replace("/etc/ecan/zenoh", &directory)
            .replace("tls/router.local:7447", &self.address)
            .replace("tls/0.0.0.0:7447", &self.address)
            .replace("ecan/cell7/master0", crate::session::PREFIX)
    }

    fn open(&self, name: &str) -> Session {
        zenoh::open(Config::from_json5(&self.text(name)).unwrap()).wait().unwrap()
    }

    /// A host with another certificate of the same authority.
    fn open_stranger(&self) -> Session {
        let text = self.text("operator").replace("/operator.", "/stranger.");
        zenoh::open(Config::from_json5(&text).unwrap()).wait().unwrap()
    }
}

/// Number of answers without errors.
fn answers(session: &Session, rest: &str) -> usize {
    let wait = Duration::from_secs(2);
    let replies = session.get(key(rest)).timeout(wait).wait().unwrap();
    replies.into_iter().filter(|reply| reply.result().is_ok()).count()
}

#[test]
fn viewer_operator_and_publisher_have_their_rights_only() {
    let Some(example) = Example::make() else { return };
    let fixture = Fixture::start(|_| ());
    let _router = example.open("router");
    let text = example.text("publisher");
    let settings = text.split_once('{').unwrap().1.rsplit_once('}').unwrap().0;
    let open = || example.open("operator");
    let published = publish_by(&fixture, &fixture.path(), config(true), settings, open);
    assert_eq!(published.open_control, None);
    let Published { remote: operator, .. } = &published;
    let (viewer, stranger) = (example.open("viewer"), example.open_stranger());
    let seen = |session: &Session| session.declare_subscriber(key("frames/*/*")).wait().unwrap();
    // Sessions of their own: Zenoh also delivers within a session.
    let (observer, other_stranger) = (example.open("viewer"), example.open_stranger());
    let (by_observer, by_stranger) = (seen(&observer), seen(&other_stranger));

    // Each one pretends to be the publisher.
    let mut tokens = Vec::new();
    for session in [operator, &viewer, &stranger] {
        session.put(key("frames/0/0"), "forged").wait().unwrap();
        tokens.push(session.liveliness().declare_token(key("alive/forged")).wait().unwrap());
    }
    let frames = || payload_of(&[record(0, 1, &[7])]);
    let sent = Remote::of(operator, "operator").act("send", frames()).unwrap();
    assert_eq!(reports(&sent)[0].event, FrameEvent::Transmitted);
    assert_eq!(
        reports(&next(&by_observer))[0].event,
        FrameEvent::Transmitted,
        "not the forged one"
    );
    assert_eq!(publishers(&viewer).len(), 1);
    assert_eq!((answers(&viewer, "state"), answers(&viewer, "frames/0/0")), (1, 1));
    let state = Remote::of(&viewer, "viewer").replies("state", Vec::new(), None, PATIENCE);
    assert_eq!(state.iter().filter(|reply| reply.result().is_ok()).count(), 1);
    let count = sent_frames(&fixture);
    let viewer = Remote::of(&viewer, "viewer");
    let nmt = json!({ "gateway": 0, "channel": 0, "node": 0, "command": "start" }).to_string();
    for (method, payload) in [("send", frames()), ("nmt", nmt.into_bytes())] {
        let deadline = Some(viewer.deadline(Duration::from_secs(5)));
        let replies = viewer.replies(method, payload, deadline, Duration::from_secs(2));
        assert!(replies.iter().all(|reply| reply.result().is_err()), "{method}: {replies:?}");
    }
    assert_eq!((answers(&stranger, "state"), answers(&stranger, "publisher/*")), (0, 0));
    assert!(by_stranger.try_recv().unwrap().is_none());
    // A later request proves that the tokens of the others have not arrived.
    Remote::of(operator, "operator").act("send", frames()).unwrap();
    wait_for("the frame", || sent_frames(&fixture) == count + 1);
    published.end().unwrap();
}
