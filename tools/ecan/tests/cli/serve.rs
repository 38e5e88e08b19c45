//! Tests of `ecan serve`.

use std::path::Path;

use ecan_protocol::can::{CanFrame, CanId};
use ecan_service::client::{Client, Event, FrameEvent, Subscription};
use serde_json::json;

use crate::support::timed_reader::LIMIT;
use crate::support::{Running, assert_has, fails};

/// Running service with its socket.
pub struct Served {
    pub directory: tempfile::TempDir,
    pub path: String,
    pub program: Running,
}

pub fn serve(options: &[&str]) -> Served {
    serve_bus("sim", options)
}

/// Starts `ecan serve` with this library. The gateways of a simulated bus have no process data watchdog: they keep
/// OP for as long as a busy host does not run the service.
pub fn serve_bus(ecrt: &str, options: &[&str]) -> Served {
    let directory = tempfile::tempdir().unwrap();
    let path = |name: &str| directory.path().join(name).display().to_string();
    let library = match ecrt.split_once("sim") {
        Some(("", scenario)) => {
            std::fs::write(path("bus.toml"), without_watchdog(scenario)).unwrap();
            format!("sim:{}", path("bus.toml"))
        }
        _ => ecrt.to_owned(),
    };
    let path = path("bus.sock");
    let arguments = [&["--ecrt", &library, "serve", "--socket", &path], options].concat();
    let mut program = Running::start(&arguments);
    program.wait_for_error("serving master 0");
    Served { directory, path, program }
}

/// Text of a scenario, given as after `sim`, with gateways that keep OP without outputs.
fn without_watchdog(scenario: &str) -> String {
    let node = |channel: u8, keys: &str| format!("[[node]]\nbus = \"0.{channel}\"\n{keys}\n");
    let drive = |(channel, id): (u8, u8)| {
        let name = format!("name = \"drive 0.{channel}/{id}\"");
        node(channel, &format!("kind = \"drive\"\n{name}\nnode_id = {id}"))
    };
    let cell = |nodes: String| format!("[[gateway]]\n{nodes}");
    let text = match scenario.trim_start_matches(':') {
        "" => cell((0..4).map(|channel| node(channel, "kind = \"echo\"")).collect()),
        "drives" => {
            let addresses = (0..4).flat_map(|channel| (1..=4).map(move |id| (channel, id)));
            cell(addresses.map(drive).collect())
        }
        file => {
            let folder = Path::new(file).parent().unwrap();
            let line = |line: &str| match line.strip_prefix("eds = \"") {
                Some(path) => format!("eds = \"{}\n", folder.join(path).display()),
                None => format!("{line}\n"),
            };
            std::fs::read_to_string(file).unwrap().lines().map(line).collect()
        }
    };
    text.replace("[[gateway]]\n", "[[gateway]]\nvariant.watchdog = \"none\"\n")
}

/// A service of a simulated bus whose gateway is ready.
pub fn serve_ready() -> Served {
    let mut served = serve(&[]);
    served.program.wait_for_error("slave 0: ready");
    served
}

impl Served {
    /// Path of a file in the directory of the socket.
    pub fn path_of(&self, name: &str) -> String {
        self.directory.path().join(name).display().to_string()
    }

    /// Starts a command that uses the service.
    pub fn run(&self, arguments: &[&str]) -> Running {
        Running::start(&[&["--via", self.path.as_str()], arguments].concat())
    }

    pub fn client(&self) -> Client {
        Client::connect(Path::new(&self.path), "test").unwrap()
    }

    pub fn end(mut self) {
        self.program.end();
        assert!(!Path::new(&self.path).exists(), "the socket is removed");
    }
}

/// Frames until the echo of the node; true for the own frame.
fn until_echo(client: &Client) -> Vec<bool> {
    let mut frames = Vec::new();
    while frames.last() != Some(&false) {
        let event = client.poll(LIMIT).unwrap().expect("a frame in time");
        if let Event::Frame(report) = event {
            frames.push(!matches!(report.event, FrameEvent::Received));
        }
    }
    frames
}

#[test]
fn clients_share_the_bus_that_recovers_from_a_fault() {
    let mut served = serve(&["--bitrate", "500000"]);
    served.program.wait_for_error("slave 0: ready");
    let (sender, observer) = (served.client(), served.client());
    sender.subscribe(&Subscription::default()).unwrap();
    observer.subscribe(&Subscription::default()).unwrap();
    let frame = CanFrame::classic(CanId::standard(0x123).unwrap(), &[1, 2]).unwrap();
    sender.send(0, 1, &frame).unwrap();
    assert_eq!(until_echo(&sender), [true, false]);
    assert_eq!(until_echo(&observer), [true, false]);

    let fault = json!({ "kind": "power_cycle", "gateway": 0, "off_ms": 100 });
    let answer = sender.call("sim.fault", fault).unwrap();
    assert!(answer["fault"].as_str().is_some_and(|text| text.contains("gateway 0")), "{answer}");
    served.program.wait_for_error("slave 0: lost");
    served.program.wait_for_error("slave 0: ready");
    let error = sender.call("sim.fault", json!({ "kind": "unknown" })).unwrap_err();
    assert!(error.to_string().contains("unknown"), "{error}");
    served.end();
}

#[test]
fn second_service_and_wrong_paths_are_rejected() {
    let served = serve(&["--idle"]);
    let error = fails(7, &["--ecrt", "sim", "serve", "--idle", "--socket", &served.path]);
    assert!(error.contains("is in use by process"), "{error}");
    let error = fails(7, &["--ecrt", "sim", "serve", "--idle", "--socket", "/none/such/bus.sock"]);
    assert!(error.contains("cannot create socket /none/such/bus.sock"), "{error}");
    let long = format!("/tmp/{}.sock", "s".repeat(120));
    let error = fails(2, &["--ecrt", "sim", "serve", "--idle", "--socket", &long]);
    assert!(error.contains("allowed: at most 99; set another path"), "{error}");
    assert_has(&fails(3, &["--via", &long, "scan"]), "allowed: at most 107 bytes");
    for option in [&["--rt-required"][..], &["--cycle-us", "500"], &["--bitrate", "1M"]] {
        let error = fails(2, &[&["--ecrt", "sim", "serve", "--idle"][..], option].concat());
        assert!(error.contains("cannot be used with"), "{option:?}: {error}");
    }
    let error = fails(2, &["--ecrt", "sim", "--slave", "0", "serve", "--idle"]);
    assert!(error.contains("--slave is not used"), "{error}");
    served.end();
}

#[test]
fn read_only_service_rejects_frames_and_faults() {
    let served = serve(&["--idle", "--read-only"]);
    let client = served.client();
    assert_eq!(client.slaves().unwrap().len(), 1);
    let fault = json!({ "kind": "power_off", "gateway": 0 });
    let error = client.call("sim.fault", fault).unwrap_err();
    assert!(error.to_string().contains("sim.fault is not permitted"), "{error}");
    served.end();
}
