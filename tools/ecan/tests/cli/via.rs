//! The way to the bus: `--via`.

use std::os::unix::net::UnixListener;
use std::process::{Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

use ecan_host::AdapterConfig;
use ecan_mcan_port::{ChannelConfig, GatewayConfig, Port, PortConfig};
use ecan_protocol::image::OptionFlags;
use ecan_service::server::{Control, ServePort as _, ServiceConfig};
use ecan_sim::{ClockKind, SimOptions};

use super::support::timed_reader::TimedReader;
use super::support::{SIM, Scenario, assert_has, fails, good, simulated};
use ecan_test_support::Killed;

#[test]
fn missing_service_names_the_socket_and_the_action() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("none.sock");
    let message = fails(3, &["--via", path.to_str().unwrap(), "scan"]);
    assert!(message.contains("none.sock") && message.contains("start the service"), "{message}");
}

#[test]
fn dead_socket_is_reported() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("dead.sock");
    drop(UnixListener::bind(&path).unwrap());
    let message = fails(3, &["--via", path.to_str().unwrap(), "sdo", "read", "0x1000:0"]);
    assert!(message.contains("no program listens there"), "{message}");
}

#[test]
fn service_and_library_exclude_each_other() {
    let message = fails(2, &["--ecrt", SIM, "--via", "/run/none.sock", "scan"]);
    assert!(message.contains("--ecrt and a service exclude each other"), "{message}");
    assert!(simulated(&["--via", "direct", "scan"]).contains("ECAN-Lite"));
}

#[test]
fn offline_command_and_serve_reject_a_service() {
    for command in ["plan", "serve"] {
        assert_has(&fails(2, &["--via", "/run/none.sock", command]), "does not use a service");
    }
}

#[test]
fn option_without_effect_is_rejected_with_a_service() {
    let application = Application::start(Control::Owner);
    let options: [&[&str]; 11] = [
        &["--rt-priority", "1"],
        &["--cpu", "0"],
        &["--lock-memory"],
        &["--rt-required"],
        &["--cpu-latency-us", "10"],
        &["--spin-us", "10"],
        &["--sample-point", "80"],
        &["--data-sample-point", "80"],
        &["--pdo-n", "3"],
        &["--large-pdos"],
        &["--cycle-us", "1000"],
    ];
    let commands: [&[&str]; 4] = [
        &["dump", "-n", "1", "--timeout", "100"],
        &["send", "123#01"],
        &["monitor", "--once"],
        &["node", "scan"],
    ];
    for (nth, option) in options.into_iter().enumerate() {
        let command = commands[nth % commands.len()];
        // clap requires the data bit rate for the sample point of its phase.
        let with_rate: &[&str] =
            if option[0] == "--data-sample-point" { &["--data-bitrate", "2M"] } else { &[] };
        let message = application.fails(2, &[command, option, with_rate].concat());
        let expected = format!("{} has no effect with a service, here cell 1.0", option[0]);
        assert!(message.contains(&expected) && message.contains("--via direct"), "{message}");
    }
    // A service that was found by itself has the same effect.
    let mut child = application.start_auto(&["dump", "-n", "1", "--rt-required"]);
    assert_eq!(child.wait().unwrap().code(), Some(2));
    // The bit rate is compared.
    application.good(&["send", "123#01", "--bitrate", "500k"]);
}

/// Socket in the directory of the user (`XDG_RUNTIME_DIR`).
const SOCKET: &str = "ecan/master0.sock";

/// An application with a cycle on a simulated bus in real time, and its service.
struct Application {
    directory: tempfile::TempDir,
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Application {
    fn start(control: Control) -> Self {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join(SOCKET);
        let config = ServiceConfig::new(&path).with_control(control).with_name("cell", "1.0");
        let options = SimOptions { clock: Some(ClockKind::Real), ..SimOptions::default() };
        let backend = ecan_sim::open_scenario(ecan_sim::echo(1), &options).unwrap();
        let mut gateway = GatewayConfig::on_channel(0, ChannelConfig::classic(500_000));
        gateway.tx_options = OptionFlags::TX_RESULT;
        let config_of_port = PortConfig::uniform(1, gateway);
        // Longer than a busy machine pauses: no frame is lost.
        let adapter = AdapterConfig::new(1).with_watchdog(Duration::from_secs(5));
        let mut port = Port::open(&backend.ecrt, (adapter, config_of_port)).unwrap();
        let service = port.serve(config).unwrap();
        port.wait_ready().unwrap();
        let stop = Arc::new(AtomicBool::new(false));
        let is_stopped = stop.clone();
        let thread = std::thread::spawn(move || {
            while !is_stopped.load(Ordering::Acquire) {
                let mut cycle = port.next_cycle();
                let _ = cycle.received().count();
                cycle.finish();
            }
            drop(service);
        });
        Self { directory, stop, thread: Some(thread) }
    }

    fn arguments<'a>(&self, path: &'a mut String, rest: &[&'a str]) -> Vec<&'a str> {
        *path = self.directory.path().join(SOCKET).to_str().unwrap().to_owned();
        [&["--via", path.as_str()][..], rest].concat()
    }

    fn good(&self, rest: &[&str]) -> String {
        good(&self.arguments(&mut String::new(), rest))
    }

    /// Starts a command that finds the service at its default path.
    fn start_auto(&self, command: &[&str]) -> Killed {
        Killed::spawn(
            Command::new(env!("CARGO_BIN_EXE_ecan"))
                .args(command)
                .env_remove("ECAN_ECRT")
                .env("XDG_RUNTIME_DIR", self.directory.path())
                .stdin(Stdio::null())
                .stdout(Stdio::piped())
                .stderr(Stdio::piped()),
        )
    }

    fn fails(&self, status: i32, rest: &[&str]) -> String {
        fails(status, &self.arguments(&mut String::new(), rest))
    }
}

impl Drop for Application {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Release);
        let _ = self.thread.take().map(JoinHandle::join);
    }
}

#[test]
fn commands_work_in_parallel_through_one_service() {
    let application = Application::start(Control::Owner);
    let commands: [&[&str]; 7] = [
        &["scan"],
        &["info"],
        &["caps"],
        &["diag"],
        &["sdo", "read", "0x8010:3"],
        &["send", "--bitrate", "500000", "123#01", "124#0203"],
        &["gen", "-n", "200", "-g", "0"],
    ];
    std::thread::scope(|scope| {
        let dump = scope.spawn(|| application.good(&["dump", "-n", "100", "-T", "60000"]));
        let threads = commands.map(|command| scope.spawn(|| application.good(command)));
        for (command, thread) in commands.iter().zip(threads) {
            assert!(!thread.join().unwrap().is_empty(), "{command:?}");
        }
        // On a busy machine it may have begun after the frames of the others.
        while !dump.is_finished() {
            application.good(&["gen", "-n", "20", "-g", "0"]);
        }
        assert_eq!(dump.join().unwrap().lines().count(), 100);
    });
}

#[test]
fn every_command_finds_and_reports_the_service() {
    let application = Application::start(Control::Owner);
    let path = application.directory.path().join(SOCKET);
    let note = format!(
        "via {}: cell 1.0 (pid {}), master 0, control, SIMULATED",
        path.display(),
        std::process::id()
    );
    let files = Scenario::new("");
    let log = files.write("a.log", "(0.000000) can0 123#00\n");
    let file = files.write("cell.toml", &good(&["config", "example"]));
    for command in [
        "scan",
        "info",
        "caps",
        "sdo read 0x8010:3",
        &format!("config diff {file}"),
        "diag",
        "send 123#00",
        "gen -n 2 -g 1",
        &format!("replay {log}"),
        "monitor --once",
        "selftest",
    ] {
        for json in [None, Some("--json")] {
            let words: Vec<_> = json.into_iter().chain(command.split(' ')).collect();
            let output = application.start_auto(&words).output();
            let errors = String::from_utf8(output.stderr).unwrap();
            assert!(matches!(output.status.code(), Some(0 | 1)), "{command}: {errors}");
            assert_eq!(errors.lines().next(), Some(note.as_str()), "{command}: {errors}");
            if json.is_some() && !output.stdout.is_empty() {
                let printed = serde_json::from_slice::<serde_json::Value>(&output.stdout);
                assert!(printed.is_ok(), "{command}: {printed:?}");
            }
        }
    }
    for command in ["dump", "bridge --slcan 127.0.0.1:0"] {
        let words: Vec<_> = ["--json"].into_iter().chain(command.split(' ')).collect();
        let mut program = application.start_auto(&words);
        let line = TimedReader::new(program.stderr.take().unwrap()).through(b'\n');
        assert_eq!(String::from_utf8(line).unwrap().trim_end(), note, "{command}");
    }
}

#[test]
fn read_only_service_rejects_with_its_reason() {
    let application = Application::start(Control::Nobody);
    assert!(application.good(&["sdo", "read", "0x8010:3"]).contains("0x8010:03"));
    let message = application.fails(3, &["sdo", "write", "0x8010:3", "1"]);
    assert!(message.contains("read-only") && message.contains("cell 1.0"), "{message}");
    assert_has(&application.fails(3, &["send", "123#01"]), "does not accept frames");
}

#[test]
fn options_that_contradict_the_service_are_rejected() {
    let application = Application::start(Control::Owner);
    let message = application.fails(2, &["send", "--bitrate", "250000", "123#01"]);
    assert!(message.contains("--bitrate") && message.contains("500000 bit/s"), "{message}");
    assert_has(&application.fails(2, &["dump", "--listen-only", "-n", "1"]), "--listen-only");
    assert_has(&application.fails(2, &["dump", "--channel", "2", "-n", "1"]), "channel 2");
    let message = application.fails(3, &["sim", "status"]);
    assert!(message.contains("cell 1.0") && message.contains("does not offer"), "{message}");
    assert_has(&application.fails(3, &["probe"]), "runs a cycle of its own");
    for command in [&["firmware", "version"][..], &["firmware", "update", "/dev/null"]] {
        let message = application.fails(3, command);
        assert!(message.contains("FoE") && message.contains("--via direct"), "{message}");
    }
}

#[test]
fn application_rejects_another_configuration() {
    let application = Application::start(Control::Owner);
    let file = application.directory.path().join("cell.toml");
    std::fs::write(&file, "[[gateway]]\nn = 3\ncan0 = { bitrate = 500_000 }\n").unwrap();
    let message = application.fails(5, &["config", "apply", file.to_str().unwrap()]);
    assert!(message.contains("cell 1.0 (pid"), "{message}");
    assert!(message.contains("change the configuration of that program"), "{message}");
}
