//! Failures of a service and of its clients: killed and stopped processes, a full disk, much memory,
//! another version.

use std::collections::BTreeMap;
use std::io::{ErrorKind, Read as _, Write as _};
use std::os::unix::net::{UnixListener, UnixStream};
use std::process::Command;

use ecan_protocol::can::{CanFrame, CanId};
use ecan_service::client::{
    Client, ClientError, Event, RecordedEvents, RecordedKind, Subscription, UploadParams,
};
use rustix::process::Signal;
use serde_json::{Value, json};

use crate::serve::serve_ready;
use crate::support::timed_reader::LIMIT;
use crate::support::{Running, assert_has, ecan, ends, fails, good, json_of, wait_for};
use ecan_test_support::Killed;

fn upload() -> UploadParams {
    UploadParams { slave: 0, index: 0x8010, subindex: 3, max_bytes: None, once: false }
}

/// The mailbox of the gateway responds to nothing for a while.
fn silence_mailbox(client: &Client) {
    let fault = json!({ "kind": "mailbox_timeout", "gateway": 0, "for_ms": 4_000_000 });
    client.call("sim.fault", fault).unwrap();
}

/// Sends a numbered frame and waits for its result and echo.
fn exchange(client: &Client, number: u16) {
    let frame = CanFrame::classic(CanId::standard(0x123).unwrap(), &number.to_be_bytes()).unwrap();
    client.send(0, 0, &frame).unwrap();
    for _ in 0..2 {
        let event = client.poll(LIMIT).unwrap();
        assert!(matches!(event, Some(Event::Frame(report)) if report.frame == frame), "{event:?}");
    }
}

/// Numbers of the frames of `exchange` in a log, each twice. An incomplete last line is ignored.
fn logged(log: &str) -> Vec<u16> {
    let text = std::fs::read_to_string(log).unwrap();
    let lines = text.rsplit_once('\n').map_or("", |(lines, _)| lines).lines();
    let data = lines.filter_map(|line| line.split_once(" can0 123#"));
    data.map(|(_, data)| u16::from_str_radix(data, 16).unwrap()).collect()
}

/// Returns whether the numbers up to `end` are complete. The first one may have only its echo.
fn is_complete(numbers: &[u16], end: u16) -> bool {
    let Some(&first) = numbers.first() else { return false };
    let rest = numbers.iter().skip_while(|number| **number == first).copied();
    rest.eq((first + 1..end).flat_map(|number| [number; 2]))
}

#[test]
fn link_loss_is_told_by_clients_and_afterwards() {
    let mut daemon = serve_ready();
    let arguments =
        ["--via", &daemon.path, "dump", "--record", &daemon.path_of("bus.log"), "--channel", "0"];
    let mut dump = Running::start(&arguments);
    let client = daemon.client();
    client.subscribe(&Subscription::default()).unwrap();
    wait_for("the subscription", || {
        exchange(&client, 1);
        let clients = client.service_stats().unwrap().clients;
        clients.iter().any(|client| client.name == "ecan" && client.frames_delivered > 0)
    });
    let fault = json!({ "kind": "link_loss", "gateway": 0, "for_ms": 3000 });
    client.call("sim.fault", fault).unwrap();
    let lost = "lost, waits for the network link of the master; check the cable";
    dump.wait_for_error(&format!("gateway: {lost}"));
    // The reports need no bus.
    let bundle = daemon.path_of("bundle.json");
    let during = ["--via", &daemon.path, "diag", "--record", &bundle];
    assert_has(&ends(3, &during), &format!(") slave 0: {lost}"));
    let recorded = json_of(&std::fs::read_to_string(&bundle).unwrap());
    assert_has(recorded["failure"].as_str().unwrap(), "no link");
    assert_has(&recorded["service"]["events"].to_string(), lost);
    assert_has(&good(&["diag", "--from", &bundle]), &format!(") slave 0: {lost}"));

    dump.wait_for_error("gateway: ready after ");
    daemon.program.wait_for_error("slave 0: ready after ");
    let is_told = |events: &RecordedEvents| {
        events
            .events
            .iter()
            .any(|event| event.kind == RecordedKind::Ready && event.duration_ns > Some(0))
    };
    wait_for("the return", || is_told(&client.events().unwrap()));
    for command in [&["diag"][..], &["monitor", "--once"]] {
        let output = ecan(&[&["--via", &daemon.path], command].concat());
        let shown = String::from_utf8(output.stdout).unwrap();
        let events = shown.split("\nevents of ecan serve ").nth(1).unwrap();
        let at = |words: &str| events.find(words).unwrap_or_else(|| panic!("{words}: {events}"));
        assert!(at(&format!(") slave 0: {lost}")) < at(") slave 0: ready after "), "{events}");
    }
    let arguments = ["--via", &daemon.path, "monitor", "--once", "--json"];
    let events = json_of(&String::from_utf8(ecan(&arguments).stdout).unwrap());
    assert_eq!(events["service_events"]["dropped"], 0);
    dump.terminate();
    let errors = dump.ends(0);
    assert_eq!(errors.matches("gateway: lost").count(), 1, "{errors}");
}

#[test]
fn killed_daemon_ends_requests_and_frame_commands_wait_for_the_next_one() {
    const FRAMES: u16 = 100;
    let daemon = serve_ready();
    let (log, capture) = (daemon.path_of("bus.log"), daemon.path_of("bus.pcapng"));
    let client = daemon.client();
    client.subscribe(&Subscription::default()).unwrap();
    let mut clients = [
        daemon.run(&["dump", "-l", &log]),
        daemon.run(&["dump", "--capture", &capture]),
        daemon.run(&["bridge"]),
    ];
    clients[2].line();
    let stats = || client.service_stats().unwrap().clients;
    // The dumps have subscribed when they receive a frame.
    let mut first = 0;
    wait_for("the subscriptions", || {
        exchange(&client, first);
        first += 1;
        stats().iter().filter(|client| client.frames_delivered > 0).count() == 4
    });
    (first..first + FRAMES).for_each(|number| exchange(&client, number));
    wait_for("the output", || stats().iter().all(|client| client.queued_bytes == 0));
    silence_mailbox(&client);
    let mut reader = daemon.run(&["sdo", "read", "0x8010:3"]);
    reader.wait_for_error("via ");
    let pending = daemon.client();
    std::thread::scope(|threads| {
        let pending = threads.spawn(|| pending.sdo_upload(&upload()));
        let requests =
            |count| stats().iter().filter(|client| client.requests >= 2).count() == count;
        wait_for("the requests", || requests(6));
        daemon.program.signal(Signal::KILL);
        assert!(matches!(pending.join().unwrap(), Err(ClientError::Closed)));
    });
    assert!(matches!(client.poll(LIMIT), Err(ClientError::Closed)));
    let message = format!("ecan: {}: the service closed the connection", daemon.path);
    assert_has(&reader.ends(3), &message);
    for program in &mut clients {
        program.wait_for_error(&format!(
            "{}: the service closed the connection; waiting for it",
            daemon.path
        ));
    }
    let numbers = logged(&log);
    assert!(numbers[0] <= first && is_complete(&numbers, first + FRAMES), "{numbers:?}");
    // Each packet of the capture has the CAN ID 0x123 and two bytes of data.
    let packet = |number: u16| [&[0, 0, 1, 0x23, 2, 0, 0, 0], &number.to_be_bytes()[..]].concat();
    let bytes = std::fs::read(&capture).unwrap();
    for number in first..first + FRAMES {
        let packet = packet(number);
        let count = bytes.windows(packet.len()).filter(|bytes| *bytes == packet).count();
        assert_eq!(count, 2, "frame {number}");
    }

    // Its socket is stale; another daemon takes its path.
    let mut next = Running::start(&["--ecrt", "sim", "serve", "--socket", &daemon.path]);
    next.wait_for_error("slave 0: ready");
    for program in &mut clients {
        program.wait_for_error("is there again");
    }
    let client = daemon.client();
    client.subscribe(&Subscription::default()).unwrap();
    let delivered = || {
        let clients = client.service_stats().unwrap().clients;
        clients.iter().filter(|client| client.frames_delivered > 0).count() == 4
    };
    let mut second = first + FRAMES;
    wait_for("the subscriptions", || {
        exchange(&client, second);
        second += 1;
        delivered()
    });
    wait_for("the log", || logged(&log).last() == Some(&(second - 1)));
    for mut program in clients {
        program.end();
    }
    let text = std::fs::read_to_string(&log).unwrap();
    assert!(text.contains("# gap: "), "the gap is marked");
}

#[test]
fn killed_clients_disturb_nobody() {
    let daemon = serve_ready();
    let client = daemon.client();
    client.subscribe(&Subscription::default()).unwrap();
    // One that sends without a pause, and one in the middle of a request.
    let sender = daemon.run(&["gen", "-g", "0", "-I", "321"]);
    let is_sent =
        |event: &Event| matches!(event, Event::Frame(sent) if sent.frame.id().raw() == 0x321);
    wait_for("frames of gen", || client.poll(LIMIT).unwrap().is_some_and(|event| is_sent(&event)));
    sender.signal(Signal::KILL);
    silence_mailbox(&client);
    let reader = daemon.run(&["sdo", "read", "0x8010:3"]);
    let stats = || client.service_stats().unwrap().clients;
    wait_for("the request", || {
        stats().iter().any(|client| client.name == "ecan" && client.requests >= 2)
    });
    reader.signal(Signal::KILL);
    wait_for("the end of both", || stats().len() == 1);
    // The frames of gen and their echoes precede this one and its echo.
    let last = CanFrame::classic(CanId::standard(0x322).unwrap(), &[]).unwrap();
    client.send(0, 0, &last).unwrap();
    let is_last = |event: &Event| matches!(event, Event::Frame(report) if report.frame == last);
    for what in ["the last frame", "its echo"] {
        wait_for(what, || client.poll(LIMIT).unwrap().is_some_and(|event| is_last(&event)));
    }
    (0..10).for_each(|number| exchange(&client, number));
    assert!(client.state().is_ok());
}

/// Runs in a mount namespace with a file system of 64 KiB at the first argument, and copies the file
/// of the second argument from there to the third one at the end.
const ON_SMALL_DISK: &str = "mount -t tmpfs -o size=64k none \"$1\" || exit 99; disk=$1 name=$2 to=$3; \
     shift 3; \"$@\"; status=$?; cp \"$disk/$name\" \"$to\"; exit $status";

#[test]
fn full_disk_ends_the_record_and_the_capture_only() {
    let may_mount = ["--map-root-user", "--mount", "mount", "-t", "tmpfs", "none", "/mnt"];
    match Command::new("unshare").args(may_mount).output() {
        Ok(output) if output.status.success() => {}
        other => return println!("skipped: no small file system can be mounted: {other:?}"),
    }
    let mut daemon = serve_ready();
    let (disk, other) = (daemon.path_of("disk"), daemon.path_of("other.log"));
    std::fs::create_dir(&disk).unwrap();
    let socket = daemon.path.clone();
    let on_small_disk = |option: &str, name: &str| {
        let (file, saved) = (format!("{disk}/{name}"), daemon.path_of(name));
        let mut command = Command::new("unshare");
        command
            .args(["--map-root-user", "--mount", "sh", "-c", ON_SMALL_DISK, "sh", &disk, name])
            .args([&saved, env!("CARGO_BIN_EXE_ecan"), "--via", &socket, "dump", option, &file])
            .stderr(std::process::Stdio::piped());
        Killed::spawn(&mut command)
    };
    let full = [on_small_disk("-l", "full.log"), on_small_disk("--capture", "full.pcapng")];
    let mut dump = daemon.run(&["dump", "-l", &other]);
    let client = daemon.client();
    client.subscribe(&Subscription::default()).unwrap();
    let stats = || client.service_stats().unwrap().clients;
    let mut number = 0;
    wait_for("the subscriptions", || {
        exchange(&client, number);
        number += 1;
        stats().iter().filter(|client| client.frames_delivered > 0).count() == 4
    });
    // Until both have ended; the other dump and this client go on.
    wait_for("the full disks", || {
        exchange(&client, number);
        number += 1;
        stats().len() == 2
    });
    for child in full {
        let output = child.output();
        let errors = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(6), "{errors}");
        let message = format!("ecan: cannot write {disk}/full.");
        assert!(errors.contains(&message) && errors.contains("No space left"), "{errors}");
    }
    for last in number..number + 10 {
        exchange(&client, last);
    }
    wait_for("the other log", || is_complete(&logged(&other), number + 10));
    dump.end();
    // The log holds all that fits; one frame of the last number may be missing.
    let mut numbers = logged(&daemon.path_of("full.log"));
    let last = numbers[numbers.len() - 1];
    numbers.retain(|number| *number != last);
    assert!(is_complete(&numbers, last), "{numbers:?}");
    daemon.program.end();
}

#[test]
fn service_of_another_version_is_reported() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("new.sock");
    let listener = UnixListener::bind(&path).unwrap();
    let text = "protocol version 1 of the client is not supported; the service has version 2; \
                install the same release of both";
    let service = std::thread::spawn(move || {
        let (mut stream, _) = listener.accept().unwrap();
        let mut head = [0; 8];
        stream.read_exact(&mut head).unwrap();
        let mut request = vec![0; u32::from_le_bytes(*head.first_chunk().unwrap()) as usize];
        stream.read_exact(&mut request).unwrap();
        let id = serde_json::from_slice::<serde_json::Value>(&request).unwrap()["id"].clone();
        let error = json!({ "code": -32002, "message": text });
        let answer = json!({ "jsonrpc": "2.0", "id": id, "error": error }).to_string();
        stream.write_all(&(answer.len() as u32).to_le_bytes()).unwrap();
        stream.write_all(&[1, 0, 0, 0]).unwrap();
        stream.write_all(answer.as_bytes()).unwrap();
    });
    let message = fails(3, &["--via", path.to_str().unwrap(), "scan"]);
    service.join().unwrap();
    assert!(message.contains(text), "{message}");
}

/// A client that is not the project's.
struct RawClient(UnixStream);

/// Number, kind and tag of a frame record.
type RawRecord = (u32, u8, u32);

impl RawClient {
    const RPC: u8 = 1;
    const TRANSMIT: u8 = 3;

    fn connect(path: &str) -> Self {
        let stream = UnixStream::connect(path).unwrap();
        stream.set_read_timeout(Some(LIMIT)).unwrap();
        let mut client = Self(stream);
        client.call("hello", json!({ "version": 1, "client": "raw" }));
        client
    }

    fn write(&mut self, kind: u8, payload: &[u8]) {
        let [a, b, c, d] = (payload.len() as u32).to_le_bytes();
        self.0.write_all(&[a, b, c, d, kind, 0, 0, 0]).unwrap();
        self.0.write_all(payload).unwrap();
    }

    fn message(&mut self) -> Vec<u8> {
        let mut head = [0; 8];
        self.0.read_exact(&mut head).unwrap();
        let length = u32::from_le_bytes(*head.first_chunk().unwrap());
        let mut payload = vec![0; length as usize];
        self.0.read_exact(&mut payload).unwrap();
        payload
    }

    fn call(&mut self, method: &str, params: Value) {
        let request = json!({ "jsonrpc": "2.0", "id": 1, "method": method, "params": params });
        self.write(Self::RPC, request.to_string().as_bytes());
        let response: Value = serde_json::from_slice(&self.message()).unwrap();
        assert!(response["error"].is_null(), "{response}");
    }

    /// Sends the classic frame 0x123 with a number as data and as tag.
    fn transmit(&mut self, number: u32) {
        let mut record = vec![0x23, 1, 0, 0, 4, 0, 0, 0, 0, 0, 0, 0];
        record.extend(number.to_le_bytes());
        record.extend(number.to_be_bytes());
        record.extend([0; 4]);
        self.write(Self::TRANSMIT, &record);
    }

    /// The records of the next message; all frames have four bytes of data.
    fn records(&mut self) -> Vec<RawRecord> {
        let number = |bytes: &[u8]| u32::from_le_bytes(*bytes.first_chunk().unwrap());
        let record =
            |record: &[u8]| (number(&record[24..]).swap_bytes(), record[17], number(&record[20..]));
        self.message().chunks_exact(32).map(record).collect()
    }

    fn result(&mut self) -> RawRecord {
        let records = self.records();
        assert_eq!(records.len(), 1, "{records:?}");
        records[0]
    }

    fn has_input(&mut self) -> bool {
        self.0.set_nonblocking(true).unwrap();
        let read = self.0.read(&mut [0]);
        self.0.set_nonblocking(false).unwrap();
        !matches!(read, Err(error) if error.kind() == ErrorKind::WouldBlock)
    }
}

/// Returns whether every thread of a process is stopped.
fn is_stopped(process: u32) -> bool {
    std::fs::read_dir(format!("/proc/{process}/task")).unwrap().all(|task| {
        let status = std::fs::read_to_string(task.unwrap().path().join("status"));
        status.unwrap_or_default().contains("State:\tT")
    })
}

#[test]
fn stopped_service_neither_loses_nor_doubles_a_frame() {
    const FRAMES: u32 = 20;
    const MARKER: u32 = 1000;
    const RECEIVED: u8 = 0;
    const TRANSMITTED: u8 = 1;
    const REJECTED: u8 = 5;
    const UNKNOWN: u8 = 6;
    let served = serve_ready();
    let mut sender = RawClient::connect(&served.path);
    let mut observer = RawClient::connect(&served.path);
    observer.call("frames.subscribe", json!({ "kinds": ["received", "transmitted"] }));
    let mut results = Vec::new();
    for number in 1..=FRAMES {
        served.program.signal(Signal::STOP);
        wait_for("the stop", || is_stopped(served.program.id()));
        sender.transmit(number);
        assert!(!sender.has_input(), "no result before it is known");
        served.program.signal(Signal::CONT);
        let (_, kind, tag) = sender.result();
        assert_eq!(tag, number);
        results.push((number, kind));
    }
    // The echo of the marker follows all frames before it.
    let mut marker = MARKER;
    loop {
        sender.transmit(marker);
        let (_, kind, tag) = sender.result();
        assert_eq!(tag, marker, "one result of each frame");
        if kind == TRANSMITTED {
            break;
        }
        marker += 1;
    }
    let mut seen = BTreeMap::<(u8, u32), u32>::new();
    while !seen.contains_key(&(RECEIVED, marker)) {
        for (number, kind, tag) in observer.records() {
            assert!(kind == RECEIVED || kind == TRANSMITTED, "{kind}, {tag} lost");
            *seen.entry((kind, number)).or_default() += 1;
        }
    }
    let count = |kind, number| seen.get(&(kind, number)).copied().unwrap_or_default();
    for (number, kind) in &results {
        let on_bus = [count(TRANSMITTED, *number), count(RECEIVED, *number)];
        match *kind {
            TRANSMITTED => assert_eq!(on_bus, [1, 1], "frame {number}"),
            REJECTED => assert_eq!(on_bus, [0, 0], "frame {number}"),
            kind => assert!(
                kind == UNKNOWN && on_bus.iter().all(|count| *count <= 1),
                "frame {number}: {on_bus:?}"
            ),
        }
    }
    assert!(results.iter().any(|(_, kind)| *kind == TRANSMITTED), "{results:?}");
    served.end();
}

/// Largest resident memory of a process until now, in KiB.
fn peak_memory(process: u32) -> u64 {
    let status = std::fs::read_to_string(format!("/proc/{process}/status")).unwrap();
    let peak = status.lines().find_map(|line| line.strip_prefix("VmHWM:")).unwrap();
    peak.trim().trim_end_matches(" kB").parse().unwrap()
}

/// Without limits the requests need 240 MB.
#[test]
fn long_requests_of_many_connections_bound_the_memory() {
    const CONNECTIONS: usize = 60;
    const REQUESTS: usize = 4;
    const BYTES: usize = 1_000_000;
    let served = serve_ready();
    let mut observer = RawClient::connect(&served.path);
    let mut attackers: Vec<_> =
        (0..CONNECTIONS).map(|_| RawClient::connect(&served.path)).collect();
    let before = peak_memory(served.program.id());
    let head = r#"{"jsonrpc":"2.0","id":2,"method":"sim.fault","params":{"unknown":""#;
    let request = format!("{head}{}\"}}}}", "x".repeat(BYTES - head.len() - 3));
    let (first, last) = request.as_bytes().split_at(BYTES - 1);
    let [a, b, c, d] = (BYTES as u32).to_le_bytes();
    for _ in 0..REQUESTS {
        // Each waits for its last byte.
        for attacker in &mut attackers {
            attacker.0.write_all(&[a, b, c, d, RawClient::RPC, 0, 0, 0]).unwrap();
            attacker.0.write_all(first).unwrap();
        }
        observer.call("bus.state", json!({}));
        attackers.iter_mut().for_each(|attacker| attacker.0.write_all(last).unwrap());
        observer.call("bus.state", json!({}));
    }
    for attacker in &mut attackers {
        (0..REQUESTS).for_each(|_| drop(attacker.message()));
    }
    let growth = peak_memory(served.program.id()) - before;
    // Twice the bytes of the incomplete requests, since buffers grow, and those that wait.
    assert!(growth < 160 * 1024, "{growth} KiB");
    served.end();
}
