//! The EtherCAT master SOEM, through Python's package `pysoem`, uses gateways of the program over a
//! veth pair. Skips if ECAN_PYTHON does not name an interpreter with the package.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{ChildStdin, Command, Stdio};

use super::support::network::{self, GATEWAYS, MASTER};
use super::support::program::{DEADLINE, Process, Running};
use super::support::raw_master::RawMaster;
use super::support::scenario::echo_without_sync0_window;
use nix::sys::signal::Signal;

/// Names the interpreter, usually that of a virtual environment.
const PYTHON_VARIABLE: &str = "ECAN_PYTHON";

/// The interpreter with the package; `None` if none is named.
fn python() -> Option<PathBuf> {
    let Some(python) = std::env::var_os(PYTHON_VARIABLE).filter(|value| !value.is_empty()) else {
        println!("skipped: {PYTHON_VARIABLE} names no interpreter with the package pysoem");
        return None;
    };
    let output = Command::new(&python).args(["-c", "import pysoem"]).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    Some(python.into())
}

/// The master in its process.
struct Master {
    process: Process,
    input: ChildStdin,
}

impl Master {
    fn start(python: &Path, case: &str, arguments: &[&str]) -> Self {
        let script = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/ecan_sim/python/soem.py");
        let mut command = Command::new(python);
        command.args(["-B", script, case]).args(arguments).stdin(Stdio::piped());
        let mut process = Process::start(&mut command);
        let input = process.child.stdin.take().unwrap();
        Self { process, input }
    }

    /// Waits for this line. The failure of the script is printed on standard error.
    fn expect(&self, line: &str) {
        let found = self.process.lines.recv_timeout(2 * DEADLINE);
        assert_eq!(found.as_deref(), Ok(line), "the message of the script is above");
    }

    /// Waits for a request, and answers it when `act` has returned.
    fn serve(&mut self, request: &str, act: impl FnOnce()) {
        self.expect(request);
        act();
        writeln!(self.input, "done").unwrap();
    }

    fn finish(mut self) {
        self.expect("passed");
        assert_eq!(self.process.rest(), [""; 0]);
        assert!(self.process.child.wait().unwrap().success());
    }
}

/// The gateways and the master of a test.
struct Peers {
    python: PathBuf,
    gateways: usize,
    scenario: Option<PathBuf>,
    program: Running,
    directory: tempfile::TempDir,
}

impl Peers {
    /// Starts the gateways; `None` if the test cannot run here.
    fn start(gateways: usize, scenario: Option<&str>) -> Option<Self> {
        let python = python()?;
        if !network::enter() {
            return None;
        }
        let directory = tempfile::tempdir().unwrap();
        let scenario = scenario.map(|text| {
            let path = directory.path().join("scenario.toml");
            std::fs::write(&path, text).unwrap();
            path
        });
        let program = start_gateways(gateways, scenario.as_deref());
        RawMaster::open(MASTER).wait_for_link();
        Some(Self { python, gateways, scenario, program, directory })
    }

    fn master(&self, case: &str, arguments: &[&str]) -> Master {
        let gateways = self.gateways.to_string();
        Master::start(&self.python, case, &[&["--gateways", &gateways], arguments].concat())
    }

    /// Runs a case that needs nothing from the test; returns the counters of the gateways.
    fn run(self, case: &str, arguments: &[&str]) -> String {
        self.master(case, arguments).finish();
        self.program.end(Signal::SIGINT)
    }

    /// Switches the gateways off and on again.
    fn power_cycle(&mut self) {
        let scenario = self.scenario.as_deref();
        let old = std::mem::replace(&mut self.program, start_gateways(self.gateways, scenario));
        old.end(Signal::SIGINT);
    }
}

fn start_gateways(gateways: usize, scenario: Option<&Path>) -> Running {
    let count = gateways.to_string();
    let mut program = match scenario {
        Some(path) => Running::start(&["--scenario", path.to_str().unwrap()]),
        None => Running::start(&["--gateways", &count]),
    };
    program.wait_for(&format!("gateway {}: booted, INIT", gateways - 1));
    program
}

/// Number of frames that the script sends through each gateway.
const FRAMES: u32 = 50;

fn echo(gateways: usize, arguments: &[&str]) {
    let scenario = echo_without_sync0_window(gateways);
    let Some(peers) = Peers::start(gateways, Some(&scenario)) else { return };
    let printed = peers.run("echo", arguments);
    assert!(!printed.contains("AL error"), "{printed}");
    assert!(printed.contains(" 0 faulty, 0 foreign, 0 lost; 0 dropped"), "{printed}");
    for nth in 0..gateways {
        let sent = format!("can0 on bus {nth}.0: {FRAMES} sent, {FRAMES} received, 0 error frames");
        assert!(printed.contains(&sent), "{sent}: {printed}");
    }
}

#[test]
fn soem_echoes_frames_with_1_chunk() {
    echo(1, &["--chunks", "1"]);
}

#[test]
fn soem_echoes_frames_with_3_chunks() {
    echo(1, &["--chunks", "3"]);
}

#[test]
fn soem_echoes_frames_with_8_chunks() {
    echo(1, &["--chunks", "8"]);
}

#[test]
fn soem_echoes_frames_with_11_chunks() {
    echo(1, &["--chunks", "11"]);
}

#[test]
fn soem_echoes_frames_of_three_gateways() {
    echo(3, &["--chunks", "3"]);
}

#[test]
fn soem_echoes_fd_frames() {
    echo(1, &["--chunks", "8", "--fd"]);
}

#[test]
fn soem_echoes_frames_with_sync0() {
    echo(1, &["--sync0"]);
    echo(3, &["--sync0"]);
}

fn case(name: &str, gateways: usize, scenario: Option<&str>) {
    if let Some(peers) = Peers::start(gateways, scenario) {
        peers.run(name, &[]);
    }
}

#[test]
fn soem_reads_writes_and_lists_objects() {
    case("sdo", 3, None);
}

#[test]
fn soem_complete_access_is_rejected_by_default() {
    case("complete_access_rejected", 1, None);
}

#[test]
fn soem_complete_access_reads_whole_object() {
    case("complete_access", 1, Some("[[gateway]]\ncomplete_access = true\n"));
}

#[test]
fn soem_reads_and_writes_sii() {
    case("sii", 3, None);
}

#[test]
fn soem_watchdog_ends_op_until_acknowledged() {
    case("watchdog", 1, None);
}

#[test]
fn soem_updates_firmware() {
    let Some(peers) = Peers::start(1, None) else { return };
    let package = peers.directory.path().join("new.bin");
    let package = package.to_str().unwrap();
    let mut master = peers.master("firmware", &["--file", package]);
    master.serve("package", || {
        let made =
            super::support::program::run(&["firmware", "--version", "3.0.7", "--out", package]);
        assert!(made.status.success());
    });
    master.finish();
    peers.program.end(Signal::SIGINT);
}

#[test]
fn soem_returns_to_op_after_power_cycle() {
    let Some(mut peers) = Peers::start(1, None) else { return };
    let mut master = peers.master("power_cycle", &[]);
    master.serve("power cycle", || peers.power_cycle());
    master.finish();
    peers.program.end(Signal::SIGINT);
}

#[test]
fn soem_continues_after_link_loss() {
    let Some(peers) = Peers::start(1, None) else { return };
    let mut master = peers.master("link_loss", &[]);
    master.serve("link down", || network::ip(&["link", "set", GATEWAYS, "down"]));
    master.serve("link up", || network::ip(&["link", "set", GATEWAYS, "up"]));
    master.finish();
    peers.program.end(Signal::SIGINT);
}
