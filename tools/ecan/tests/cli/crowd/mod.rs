//! An application with a cycle of 1 ms and all kinds of clients of its service at once: no frame is
//! lost or doubled for the application, the bridges and `dump`; what another client loses is counted
//! exactly.
//!
//! ```text
//! CROWD_SECONDS=60 cargo test --release -p ecan-tool --test cli crowd -- --nocapture
//! ```
//!
//! No party is far ahead of another one, so that the test also passes on a busy machine; only its
//! duration depends on the machine. It prints the missed cycles with and without clients;
//! `CROWD_PRIORITY=80` lets the cycle run with that priority of SCHED_FIFO.

mod application;
mod bridge_client;
mod sequence;

use std::io::{BufRead as _, BufReader, Write as _};
use std::path::{Path, PathBuf};
use std::process::{ChildStdin, ChildStdout, Command, Stdio};
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{scope, sleep};
use std::time::{Duration, Instant};

use ecan_protocol::can::{CanFrame, CanId};
use ecan_service::client::{Client, ClientStats, Event, FrameEvent, ServiceStats, Subscription};
use rustix::process::{Pid, Signal, kill_process};
use serde_json::{Value, json};

use self::bridge_client::{BridgeClient, Progress, Protocol};
use self::sequence::{APPLICATION, CLIENT, Sequence};
use crate::support::timed_reader::{LIMIT, TimedReader};
use crate::support::{Running, ecan};
use ecan_test_support::{Killed, OnDrop};

const SOCKET: &str = "ECAN_TEST_CROWD_SOCKET";
/// Frames that the application is ahead of the slowest observer of a channel.
const AHEAD: u64 = 500;
/// Interval of the reads of `ecan monitor`.
const MONITOR_INTERVAL: Duration = Duration::from_millis(100);
const PROTOCOLS: [Protocol; 4] =
    [Protocol::Socketcand, Protocol::Slcan, Protocol::Socketcand, Protocol::Slcan];

#[test]
#[ignore = "run by the test below in a process of its own"]
fn application_process() {
    if let Some(path) = std::env::var_os(SOCKET) {
        application::run(Path::new(&path));
    }
}

/// The process of the application.
struct Application {
    _directory: tempfile::TempDir,
    path: PathBuf,
    /// Dropped first: the end of its input ends the process.
    commands: ChildStdin,
    answers: TimedReader,
    _child: Killed,
}

impl Application {
    fn start() -> Self {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("cell.sock");
        let mut command = Command::new(std::env::current_exe().unwrap());
        command
            .args(["--exact", "crowd::application_process", "--ignored", "--nocapture"])
            .env(SOCKET, &path)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped());
        let mut child = Killed::spawn(&mut command);
        let commands = child.stdin.take().unwrap();
        let answers = TimedReader::new(child.stdout.take().unwrap());
        let mut application =
            Self { _directory: directory, path, commands, answers, _child: child };
        assert_eq!(application.answer(), "ready");
        application
    }

    /// The next line of the application; others are of the test harness.
    fn answer(&mut self) -> Value {
        let json = |line: &str| {
            let start = line.find(['{', '"'])?;
            serde_json::from_str(line[start..].trim_end()).ok()
        };
        loop {
            let line = String::from_utf8(self.answers.through(b'\n')).unwrap();
            assert!(!line.is_empty(), "the application has ended");
            if let Some(answer) = json(&line) {
                return answer;
            }
        }
    }

    fn say(&mut self, command: &str) {
        writeln!(self.commands, "{command}").unwrap();
    }

    fn report(&mut self) -> Value {
        self.say("report");
        self.answer()
    }

    fn set_credit(&mut self, credit: [u64; 4]) {
        let [a, b, c, d] = credit;
        self.say(&format!("credit {a} {b} {c} {d}"));
    }

    fn client(&self, name: &str) -> Client {
        Client::connect(&self.path, name).unwrap()
    }

    fn program(&self, arguments: &[&str]) -> Running {
        Running::start(&[&["--via", self.path.to_str().unwrap()], arguments].concat())
    }

    /// A program whose output another thread reads.
    fn child_program(&self, arguments: &[&str]) -> Killed {
        let mut command = Command::new(env!("CARGO_BIN_EXE_ecan"));
        let command = command.arg("--via").arg(&self.path).args(arguments);
        Killed::spawn(command.stdout(Stdio::piped()))
    }
}

/// Waits until the condition is met; fails when it is not for long.
fn wait_for(what: &str, mut condition: impl FnMut() -> bool) {
    let end = Instant::now() + 2 * LIMIT;
    while !condition() {
        assert!(Instant::now() < end, "waited for {what}");
        sleep(Duration::from_millis(2));
    }
}

fn numbers(report: &Value, name: &str) -> [u64; 4] {
    serde_json::from_value(report[name].clone()).unwrap()
}

/// Frames that `ecan dump` prints, by channel, of the application and of the clients.
#[derive(Debug)]
struct Dumped {
    frames: Mutex<[[Sequence; 2]; 4]>,
    has_begun: AtomicBool,
}

impl Dumped {
    fn read(&self, dump: ChildStdout) {
        for line in BufReader::new(dump).lines().map(Result::unwrap) {
            // (1.0) can2 100#0000000000000007
            let (channel, frame) = line.split_once(" can").unwrap().1.split_once(' ').unwrap();
            let (id, data) = frame.split_once('#').unwrap();
            self.has_begun.store(true, Ordering::Release);
            let party = match u16::from_str_radix(id, 16).unwrap() {
                APPLICATION => 0,
                CLIENT => 1,
                _ => continue,
            };
            let mut frames = self.frames.lock().unwrap();
            let sequence = &mut frames[channel.parse::<usize>().unwrap()][party];
            let number = u64::from_str_radix(data, 16).unwrap();
            assert!(sequence.take(number), "{line} after {sequence:?}");
        }
    }

    /// Frames of the application or of the clients that were printed twice.
    fn twice(&self, party: usize) -> [u64; 4] {
        self.frames.lock().unwrap().map(|of_channel| of_channel[party].twice)
    }
}

/// Frames and losses that a client has not read yet.
fn read_rest(client: &Client) -> (u64, u64) {
    let (mut read, mut lost) = (0, 0);
    while let Some(event) = client.poll(Duration::ZERO).unwrap() {
        match event {
            Event::Frame(_) => read += 1,
            Event::Lost(losses) => lost += losses.frames + losses.frames_in_client,
            other => panic!("{other:?}"),
        }
    }
    (read, lost)
}

fn stats_of(stats: &ServiceStats, name: &str) -> ClientStats {
    stats.clients.iter().find(|client| client.name == name).unwrap().clone()
}

fn total(numbers: [u64; 4]) -> u64 {
    numbers.iter().sum()
}

/// All frames so far, by channel.
#[derive(Clone, Copy, Debug)]
struct Totals {
    of_application: [u64; 4],
    of_clients: [u64; 4],
    markers: u64,
}

#[test]
fn crowd_of_clients_loses_and_doubles_no_frame() {
    let seconds: u64 = std::env::var("CROWD_SECONDS").map_or(2, |text| text.parse().unwrap());
    let mut application = Application::start();
    let before = 1000 * seconds;
    let alone = without_clients(&mut application, before);

    let observer = application.client("observer");
    let dumped = &Dumped {
        frames: Mutex::new([[Sequence::before(before), Sequence::default()]; 4]),
        has_begun: AtomicBool::new(false),
    };
    let progress: &[Progress; 4] = &Default::default();
    let is_over = &AtomicBool::new(false);
    scope(|threads| {
        // If the test fails, the threads end: the scope joins them.
        let _end = OnDrop(|| {
            is_over.store(true, Ordering::Release);
            progress.iter().for_each(|client| client.is_stopped.store(true, Ordering::Release));
        });
        let mut dump = application.child_program(&["dump", "-L"]);
        let printed = dump.stdout.take().unwrap();
        let mut observers = vec![threads.spawn(|| dumped.read(printed))];
        let markers = mark_begin(&mut application, &observer, dumped);
        let silent = application.client("never reads");
        silent.subscribe(&Subscription::default()).unwrap();
        let start = application.report();
        let mut bridges = Vec::new();
        for ((channel, protocol), progress) in (0..).zip(PROTOCOLS).zip(progress) {
            let options = ["bridge", "--channel", &format!("{channel}"), protocol.option()];
            let mut bridge = application.program(&options);
            let client = BridgeClient::connect(protocol, &mut bridge);
            observers.push(threads.spawn(move || client.run(progress, before)));
            bridges.push(bridge);
        }
        let monitor = application.client("monitor");
        let monitor = threads.spawn(move || poll_state(&monitor, is_over));
        let path = application.path.clone();
        let diagnosis = threads.spawn(move || diagnose(&path, is_over));

        application.say("clear");
        let first_cycle = observer.state().unwrap().cycle.cycle;
        let end = Instant::now() + Duration::from_secs(seconds) + 2 * LIMIT;
        let mut next_look = Instant::now();
        // An observer that has failed is joined below.
        while !observers.iter().any(|observer| observer.is_finished()) {
            let printed = dumped.twice(0);
            let seen = progress.each_ref().map(|seen| seen.application.load(Ordering::Acquire));
            let credit = |at: usize| printed[at].min(seen[at]).max(before) + AHEAD;
            application.set_credit(std::array::from_fn(credit));
            if Instant::now() >= next_look {
                next_look = Instant::now() + MONITOR_INTERVAL;
                let cycles = observer.state().unwrap().cycle.cycle - first_cycle;
                let silent = stats_of(&observer.service_stats().unwrap(), "never reads");
                if cycles >= 1000 * seconds && silent.frames_lost > 0 {
                    break;
                }
                assert!(Instant::now() < end, "{cycles} cycles, {silent:?}");
            }
            sleep(Duration::from_millis(5));
        }
        is_over.store(true, Ordering::Release);
        progress.iter().for_each(|client| client.is_stopped.store(true, Ordering::Release));
        wait_for("the echoes of the clients", || {
            progress.iter().all(|seen| seen.is_quiet.load(Ordering::Acquire))
        });
        application.set_credit([0; 4]);
        let of_clients = progress.each_ref().map(|seen| seen.sent.load(Ordering::Acquire));
        let report = final_report(&mut application, of_clients);
        let totals = Totals { of_application: numbers(&report, "sent"), of_clients, markers };
        wait_for("the frames of all observers", || {
            let seen = progress.each_ref().map(|seen| seen.application.load(Ordering::Acquire));
            let (of_application, of_clients) = (dumped.twice(0), dumped.twice(1));
            seen == totals.of_application
                && (of_application, of_clients) == (totals.of_application, totals.of_clients)
        });
        println!("without clients: {alone}\nwith clients: {report}");
        let (polls, diagnoses) = (monitor.join().unwrap(), diagnosis.join().unwrap());
        println!("{polls} polls of the monitor, {diagnoses} runs of diag");

        check_simulator(&report, totals);
        let count = |report: &Value| total(numbers(&report["simulated"], "frames"));
        check_losses(&observer, &silent, count(&report) - count(&start));
        for bridge in &mut bridges {
            let errors = bridge.end();
            assert!(!errors.contains('#'), "{errors}");
        }
        kill_process(Pid::from_child(&dump), Signal::TERM).unwrap();
        assert!(dump.wait().unwrap().success());
    });
}

/// Lets the application send; returns its report.
fn without_clients(application: &mut Application, frames: u64) -> Value {
    application.say("clear");
    application.set_credit([frames; 4]);
    loop {
        sleep(MONITOR_INTERVAL);
        let report = application.report();
        if numbers(&report, "echoed") == [frames; 4] {
            return report;
        }
    }
}

/// Sends marker frames until the dump prints them, and waits until nobody awaits any; returns their
/// number.
fn mark_begin(application: &mut Application, client: &Client, dumped: &Dumped) -> u64 {
    let marker = CanFrame::classic(CanId::standard(0x7FF).unwrap(), &[]).unwrap();
    let mut markers = 0;
    wait_for("the dump", || {
        client.send(0, 0, &marker).unwrap();
        markers += 1;
        let Some(Event::Frame(report)) = client.poll(LIMIT).unwrap() else { panic!("no result") };
        assert_eq!(report.event, FrameEvent::Transmitted);
        dumped.has_begun.load(Ordering::Acquire)
    });
    wait_for("the echoes", || numbers(&application.report(), "others")[0] == markers);
    markers
}

/// Reads what `ecan monitor` reads; returns how often.
fn poll_state(client: &Client, is_over: &AtomicBool) -> u64 {
    let mut polls = 0;
    while !is_over.load(Ordering::Acquire) {
        client.state().unwrap();
        client.axes().unwrap();
        polls += 1;
        sleep(MONITOR_INTERVAL);
    }
    polls
}

/// Runs `ecan diag` again and again; returns how often.
fn diagnose(path: &Path, is_over: &AtomicBool) -> u64 {
    let mut runs = 0;
    while !is_over.load(Ordering::Acquire) {
        let output = ecan(&["--via", path.to_str().unwrap(), "diag"]);
        assert_eq!(output.status.code(), Some(0), "{output:?}");
        runs += 1;
    }
    runs
}

/// The report after the last echo.
fn final_report(application: &mut Application, of_clients: [u64; 4]) -> Value {
    let mut report = Value::Null;
    wait_for("the last echoes", || {
        report = application.report();
        numbers(&report, "sent") == numbers(&report, "echoed")
            && numbers(&report, "of_client") == of_clients
    });
    report
}

/// The simulator counts each frame and its echo, and the application has received every echo in order.
fn check_simulator(report: &Value, totals: Totals) {
    let Totals { of_application, of_clients, markers } = totals;
    let simulated = &report["simulated"];
    let sent = total(of_application) + total(of_clients) + markers;
    assert_eq!(total(numbers(simulated, "frames")), 2 * sent);
    for counter in ["to_bus", "from_bus", "to_master"] {
        assert_eq!(simulated[counter], sent, "{counter}");
    }
    assert_eq!((&simulated["has_losses"], &simulated["results_lost"]), (&json!(false), &json!(0)));
    assert_eq!((numbers(report, "faults"), &report["sessions_lost"]), ([0; 4], &json!(0)));
}

/// Only the client that never read has lost frames; what it reads now, and the loss records, are all frames of the buses.
fn check_losses(observer: &Client, silent: &Client, frames: u64) {
    let stats = observer.service_stats().unwrap();
    assert_eq!(stats.frames_lost_in_ring, 0);
    let others = stats.clients.iter().filter(|client| client.name != "never reads");
    assert_eq!(others.map(|client| client.frames_lost).sum::<u64>(), 0, "{stats:?}");
    let ClientStats { frames_delivered, frames_lost, .. } = stats_of(&stats, "never reads");
    assert_eq!(frames_delivered + frames_lost, frames);
    println!("the client that never reads lost {frames_lost} of {frames} frames");
    let (mut read, mut lost) = (0, 0);
    wait_for("the rest of the client that never reads", || {
        let rest = read_rest(silent);
        (read, lost) = (read + rest.0, lost + rest.1);
        read + lost >= frames
    });
    assert_eq!((read, lost), (frames_delivered, frames_lost));
}
