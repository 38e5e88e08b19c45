//! `ecan zenoh`: a service on other hosts, and the Python package `eclipse-zenoh` as one of them.

use std::collections::BTreeSet;
use std::net::TcpListener;
use std::path::Path;
use std::process::Command;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

use ecan_protocol::can::{CanFrame, CanId};
use ecan_service::client::{Client, Event, Subscription};

use crate::support::python::{python_with, skip};
use crate::support::timed_reader::LIMIT;
use crate::support::{Running, assert_has, fails, good, wait_for};
use ecan_test_support::OnDrop;

/// CAN ID of the frames that are counted.
const COUNTED: u16 = 0x321;
const COUNTED_TEXT: &str = "321";
const PREFIX: &str = "bench/master0";

struct Served {
    directory: tempfile::TempDir,
    socket: String,
    program: Running,
}

fn serve(options: &[&str]) -> Served {
    let directory = tempfile::tempdir().unwrap();
    let socket = directory.path().join("bus.sock").display().to_string();
    let program = start(&socket, options);
    Served { directory, socket, program }
}

fn start(socket: &str, options: &[&str]) -> Running {
    let arguments = [&["--ecrt", "sim", "serve", "--socket", socket], options].concat();
    let mut program = Running::start(&arguments);
    program.wait_for_error("serving master 0");
    program
}

impl Served {
    /// Writes a configuration file of Zenoh.
    fn config(&self, name: &str, text: &str) -> String {
        let path = self.directory.path().join(name).display().to_string();
        std::fs::write(&path, text).unwrap();
        path
    }

    fn fails(&self, status: i32, rest: &[&str]) -> String {
        fails(status, &[&["--via", &self.socket, "zenoh"], rest].concat())
    }
}

/// An address that was free a moment ago.
fn free_address() -> String {
    TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().to_string()
}

#[test]
fn wrong_configuration_is_reported_and_the_service_continues() {
    let served = serve(&["--idle"]);
    assert_has(&served.fails(6, &["/none/zenoh.json5"]), "/none/zenoh.json5: No such file");
    let message = served.fails(6, &[&served.config("mode.json5", "{ mode: 'fast' }")]);
    assert!(message.contains("mode.json5") && message.contains("`fast`"), "{message}");
    let message = served.fails(6, &[&served.config("empty.json5", "{}")]);
    assert!(message.contains("permits no connection; set connect.endpoints"), "{message}");
    let router = free_address();
    let text = format!("{{ mode: 'client', connect: {{ endpoints: ['tcp/{router}'] }} }}");
    let message = served.fails(6, &[&served.config("router.json5", &text)]);
    assert!(message.contains("cannot open the Zenoh session"), "{message}");
    assert!(message.contains(&router), "{message}");
    assert_has(&served.fails(2, &["--prefix", "a/*", "router.json5"]), "prefix \"a/*\" is invalid");
    let message = served.fails(2, &["--control", "--transmit", "0.4", "router.json5"]);
    assert!(message.contains("transmit limit \"0.4\" is invalid"), "{message}");
    assert_has(&served.fails(2, &["--transmit", "0.1:123", "router.json5"]), "--control");
    let message = fails(3, &["--via", "direct", "zenoh", "router.json5"]);
    assert!(message.contains("no service to publish; start ecan serve"), "{message}");
    assert!(good(&["--via", &served.socket, "scan"]).contains("ECAN-Lite"));
}

#[test]
fn publication_outlives_its_service() {
    let mut served = serve(&["--idle", "--read-only"]);
    let text = format!("{{ listen: {{ endpoints: ['tcp/{}'] }} }}", free_address());
    let file = served.config("zenoh.json5", &text);
    let mut publication = Running::start(&["--via", &served.socket, "zenoh", &file, "--control"]);
    publication.wait_for_error("warning: --control has no effect: the service is read-only");
    publication.wait_for_error("warning: control is open in ");
    publication.wait_for_error("zenoh: connected to 0 routers, 0 peers");
    served.program.signal(rustix::process::Signal::STOP);
    publication.wait_for_error("warning: the service does not respond");
    served.program.signal(rustix::process::Signal::CONT);
    publication.wait_for_error("service responds again");
    served.program.end();
    publication.wait_for_error("service lost: ");
    served.program = start(&served.socket, &["--idle"]);
    publication.wait_for_error("service found again");
    publication.end();
}

/// A program that uses a published service.
fn remote(peer: &str, arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_ecan"));
    let via = format!("zenoh:{PREFIX}");
    command.env("ZENOH_CONFIG", peer).args(["--via", &via]).args(arguments);
    command
}

#[test]
fn commands_reach_a_service_of_another_host() {
    let directory = tempfile::tempdir().unwrap();
    let socket = directory.path().join("bus.sock").display().to_string();
    let mut program = Running::start(&["--ecrt", "sim:drives", "serve", "--socket", &socket]);
    program.wait_for_error("slave 0: ready");
    let served = Served { directory, socket, program };
    let address = free_address();
    let endpoints = format!("{{ endpoints: ['tcp/{address}'] }}");
    let file = served.config("zenoh.json5", &format!("{{ listen: {endpoints} }}"));
    let peer = served.config("peer.json5", &format!("{{ mode: 'client', connect: {endpoints} }}"));
    let options = ["zenoh", &file, "--prefix", PREFIX, "--control", "--gather", "0"];
    let publish = || {
        let mut publication = Running::start(&[&["--via", &served.socket][..], &options].concat());
        publication.wait_for_error("zenoh: connected to 0 routers");
        publication
    };
    let mut publication = publish();
    let of_remote = |arguments: &[&str]| {
        let output = remote(&peer, arguments).output().unwrap();
        let errors = String::from_utf8(output.stderr).unwrap();
        assert!(errors.starts_with(&format!("via zenoh:{PREFIX}: ecan serve")), "{errors}");
        (output.status.code(), String::from_utf8(output.stdout).unwrap())
    };
    let local = |arguments: &[&str]| good(&[&["--via", &served.socket][..], arguments].concat());
    for arguments in [
        &["scan"][..],
        &["--json", "info"],
        &["send", "--channel", "0", "123#11", "18ff0001##1aabb", "124#R"],
        &["node", "scan", "--channel", "1"],
        &["node", "sdo", "read", "--node", "2", "0x1018:4"],
        &["sdo", "read", "0x1008"],
        &["axis", "status", "--node", "1"],
    ] {
        assert_eq!(of_remote(arguments), (Some(0), local(arguments)), "{arguments:?}");
    }
    // Only the owner of the master moves an axis.
    assert_eq!(of_remote(&["axis", "stop", "--node", "1"]).0, Some(3));
    let monitor = of_remote(&["monitor", "--once"]).1;
    assert!(
        monitor.contains("can0     run ") && monitor.contains("ecan zenoh: frames"),
        "{monitor}"
    );

    // A command without an end outlives the publisher.
    let mut dump = Running::spawn(&mut remote(&peer, &["dump", "--channel", "0"]));
    let wait_for_frame = |dump: &mut Running, frame: &str, shown: &str| {
        let stop = AtomicBool::new(false);
        std::thread::scope(|scope| {
            let _stop = OnDrop(|| stop.store(true, Ordering::Release));
            // Until the subscription has arrived.
            scope.spawn(|| {
                while !stop.load(Ordering::Acquire) {
                    local(&["send", "--channel", "0", frame]);
                }
            });
            while !dump.line().contains(shown) {}
        });
    };
    wait_for_frame(&mut dump, "125#11", "125   [1]  11");
    publication.end();
    dump.wait_for_error("the service closed the connection; waiting for it");
    let mut publication = publish();
    dump.wait_for_error("is there again");
    dump.wait_for_error("gateway: ready");
    wait_for_frame(&mut dump, "125#22", "125   [1]  22");
    dump.end();
    publication.end();
    let output = remote(&peer, &["scan"]).output().unwrap();
    let errors = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(6), "{errors}");
    assert_has(&errors, "cannot open the Zenoh session: Unable to connect");
    let wrong = fails(2, &["--via", "zenoh:a/*", "scan"]);
    assert_has(&wrong, "prefix \"a/*\" is invalid; allowed");
}

#[test]
fn unit_publishes_with_valid_options() {
    let unit = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../examples/zenoh");
    let unit = std::fs::read_to_string(unit.join("ecan-zenoh@.service")).unwrap();
    let start = unit.lines().find_map(|line| line.strip_prefix("ExecStart=/usr/local/bin/ecan "));
    let start = start.unwrap().replace("%i", "0");
    let arguments: Vec<_> = start.split(' ').chain(["--help"]).collect();
    assert_has(&good(&arguments), "Publish a service to other hosts");
}

/// Two network namespaces, joined by a cable.
struct Hosts {
    names: [String; 2],
}

fn ip(arguments: &[&str]) -> Result<(), String> {
    let output = Command::new("ip").args(arguments).output();
    let output = output.map_err(|error| format!("ip: {error}"))?;
    match output.status.success() {
        true => Ok(()),
        false => Err(String::from_utf8_lossy(&output.stderr).trim().to_owned()),
    }
}

impl Hosts {
    fn connect() -> Result<Self, String> {
        let id = std::process::id();
        let hosts = Self { names: [format!("ecan-zenoh-a-{id}"), format!("ecan-zenoh-b-{id}")] };
        let [a, b] = &hosts.names;
        ip(&["netns", "add", a])?;
        ip(&["netns", "add", b])?;
        let end = ["link", "add", "cable", "type", "veth", "peer", "name", "cable", "netns", b];
        ip(&[&["-n", a], &end[..]].concat())?;
        for (name, address) in [(a, "10.0.0.1/24"), (b, "10.0.0.2/24")] {
            ip(&["-n", name, "address", "add", address, "dev", "cable"])?;
            ip(&["-n", name, "link", "set", "cable", "up"])?;
        }
        Ok(hosts)
    }

    fn set_cable(&self, state: &str) {
        ip(&["-n", &self.names[0], "link", "set", "cable", state]).unwrap();
    }

    /// A program on one of the hosts.
    fn command(&self, host: usize, program: &[&str]) -> Command {
        let mut command = Command::new("ip");
        command.args(["netns", "exec", &self.names[host]]).args(program);
        command
    }
}

impl Drop for Hosts {
    fn drop(&mut self) {
        for name in &self.names {
            let _ = ip(&["netns", "delete", name]);
        }
    }
}

/// Sends numbered frames one by one on a channel until `stop`; returns the number of frames of this
/// channel that the service delivered.
fn send_numbered(socket: &str, channel: u8, sent: &AtomicU64, stop: &AtomicBool) -> u64 {
    let client = Client::connect(Path::new(socket), "test").unwrap();
    client.subscribe(&Subscription { channels: vec![channel], ..Subscription::default() }).unwrap();
    let id = CanId::standard(COUNTED).unwrap();
    let mut delivered = 0;
    let mut take = |wait| match client.poll(wait).unwrap() {
        Some(Event::Frame(report)) => {
            delivered += 1;
            report.frame.id() == id && report.tag == 0
        }
        Some(other) => panic!("{other:?}"),
        None => panic!("no frame in time"),
    };
    while !stop.load(Ordering::Acquire) {
        let number = sent.fetch_add(1, Ordering::AcqRel);
        client.send(0, channel, &CanFrame::classic(id, &number.to_be_bytes()).unwrap()).unwrap();
        // The answer of the echo node is the last event of a frame.
        while !take(LIMIT) {}
    }
    delivered
}

#[test]
fn python_on_another_host_counts_what_a_cut_cable_loses() {
    let Some(python) = python_with(&["zenoh"], "eclipse-zenoh") else { return };
    let hosts = match Hosts::connect() {
        Ok(hosts) => hosts,
        Err(reason) => return skip(&format!("no network namespaces ({reason})")),
    };
    let mut served = serve(&["--bitrate", "1000000"]);
    served.program.wait_for_error("slave 0: ready");
    let transport = "transport: { link: { tx: { lease: 2000 } } }";
    let listen = "listen: { endpoints: ['tcp/10.0.0.1:7447'] }";
    let publisher = served.config("a.json5", &format!("{{ {listen}, {transport} }}"));
    let peer = served.config(
        "b.json5",
        &format!(
            "{{ {transport}, listen: {{ endpoints: [] }}, scouting: {{ multicast: {{ enabled: false }} }},
               connect: {{ endpoints: ['tcp/10.0.0.1:7447'],
                          retry: {{ period_init_ms: 200, period_max_ms: 200 }} }} }}"
        ),
    );
    let options = ["--control", "--prefix", PREFIX, "--interval", "100", &publisher];
    let program = [env!("CARGO_BIN_EXE_ecan"), "--via", &served.socket, "zenoh"];
    let mut publication = Running::spawn(&mut hosts.command(0, &[&program[..], &options].concat()));
    wait_for_peers(&mut publication, 0);
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/../../examples/python/zenoh_client.py");
    let client = [&python, "-B", script, &peer, PREFIX];
    let request = |rest: &[&str]| {
        let output = hosts.command(1, &[&client[..], rest].concat()).output().unwrap();
        let errors = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "{rest:?}: {errors}");
        String::from_utf8(output.stdout).unwrap()
    };
    let mut observer = Running::spawn(&mut hosts.command(1, &client));
    wait_for_peers(&mut publication, 1);
    let (sent, stop) = (AtomicU64::new(0), AtomicBool::new(false));

    // Until the subscription has arrived.
    std::thread::scope(|scope| {
        let _stop = OnDrop(|| stop.store(true, Ordering::Release));
        let sender = scope.spawn(|| send_numbered(&served.socket, 1, &sent, &stop));
        observer.line();
        stop.store(true, Ordering::Release);
        sender.join().unwrap();
    });
    assert!(request(&["state"]).contains("\"session\":\"ready\""));
    assert!(request(&["axes"]).contains("\"axes\":[]"));
    let object = r#"{"slave":0,"index":4096,"subindex":0}"#;
    assert!(request(&["sdo.upload", object]).contains("\"data\":"));

    sent.store(0, Ordering::Release);
    stop.store(false, Ordering::Release);
    let mut shown = Shown::default();
    let delivered = std::thread::scope(|scope| {
        let _stop = OnDrop(|| stop.store(true, Ordering::Release));
        let sender = scope.spawn(|| send_numbered(&served.socket, 0, &sent, &stop));
        shown.read_until(&mut observer, |number| number > 100);
        assert_has(&request(&["send", "0", "0", "123#1122"]), " 0.0 transmitted 123 [2] 1122");

        hosts.set_cable("down");
        wait_for_peers(&mut publication, 0);
        let at_cut = sent.load(Ordering::Acquire);
        wait_for("frames while it is cut", || sent.load(Ordering::Acquire) >= at_cut + 100);
        hosts.set_cable("up");
        wait_for_peers(&mut publication, 1);
        let at_return = sent.load(Ordering::Acquire);
        shown.read_until(&mut observer, |number| number > at_return);
        stop.store(true, Ordering::Release);
        sender.join().unwrap()
    });
    let sent = sent.load(Ordering::Acquire);
    shown.read_until(&mut observer, |number| number == sent - 1);
    observer.signal(rustix::process::Signal::INT);
    let account = shown.read_account(&mut observer);
    let lost = delivered - shown.frames;
    let expected =
        format!("{} received, {lost} lost, 0 lost in the service (all channels)", shown.frames);
    assert_eq!(account, format!("{PREFIX}/frames/0/0: {expected}"));
    assert_eq!(lost, 2 * sent - shown.numbers.len() as u64, "by the numbers of the frames");
    assert!(lost > 0, "the cut lost nothing");
    assert_eq!(observer.wait().0, Some(0));
    publication.end();
    served.program.end();
}

/// Reads the connections that the publication reports until it has this number of peers.
fn wait_for_peers(publication: &mut Running, peers: u32) {
    loop {
        let line = publication.error_line();
        assert!(!line.is_empty(), "the publication ended: {}", publication.wait().1);
        if line.ends_with(&format!(", {peers} peers")) {
            break;
        }
    }
}

/// Frames of channel 0 that the client in Python has printed.
#[derive(Default)]
struct Shown {
    frames: u64,
    /// Event and number of each counted frame.
    numbers: BTreeSet<(String, u64)>,
}

impl Shown {
    fn read(&mut self, line: &str) -> Option<u64> {
        let words: Vec<_> = line.split(' ').collect();
        let [_, "0.0", event, id, _, data] = words[..] else { return None };
        self.frames += 1;
        (id == COUNTED_TEXT).then(|| {
            let number = u64::from_str_radix(data, 16).unwrap();
            assert!(self.numbers.insert((event.to_owned(), number)), "{line} again");
            number
        })
    }

    /// Reads until the answer to a frame with such a number.
    fn read_until(&mut self, observer: &mut Running, is_enough: impl Fn(u64) -> bool) {
        loop {
            let line = observer.line();
            assert!(!line.is_empty(), "the client ended: {}", observer.wait().1);
            if self.read(&line).is_some_and(&is_enough) && line.contains(" received ") {
                break;
            }
        }
    }

    /// Reads the account of channel 0 at the end.
    fn read_account(&mut self, observer: &mut Running) -> String {
        loop {
            let line = observer.line();
            assert!(!line.is_empty(), "the client ended: {}", observer.wait().1);
            if line.starts_with(PREFIX) && line.contains("/frames/0/0: ") {
                return line;
            }
            self.read(&line);
        }
    }
}
