//! `ecan serve` as a daemon: service manager, signals, failures.

use std::os::unix::net::{UnixDatagram, UnixListener};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Duration;

use ecan_service::client::Client;
use nix::sys::ptrace;
use nix::unistd::Pid;
use rustix::process::Signal;
use serde_json::json;

use super::serve::serve;
use super::support::timed_reader::LIMIT;
use super::support::{Running, assert_has, fails, good, scenario, setting, wait_for};

const FILE: &str = "\
watchdog_us = 2_000_000
[[gateway]]
n = 3
can0 = { bitrate = 500_000 }
";

const WATCHDOG: Duration = Duration::from_secs(2);

/// Service manager that receives the notifications of a service with this configuration.
struct Manager {
    directory: tempfile::TempDir,
    notifications: UnixDatagram,
    /// All messages without those of the watchdog.
    log: String,
    pings: usize,
}

impl Manager {
    fn new(file: &str) -> Self {
        let directory = tempfile::tempdir().unwrap();
        std::fs::write(directory.path().join("cell.toml"), file).unwrap();
        let notifications = UnixDatagram::bind(directory.path().join("notify")).unwrap();
        notifications.set_read_timeout(Some(LIMIT)).unwrap();
        Self { directory, notifications, log: String::new(), pings: 0 }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.directory.path().join(name)
    }

    fn socket(&self) -> String {
        self.path("bus.sock").display().to_string()
    }

    fn write(&self, file: &str) {
        std::fs::write(self.path("cell.toml"), file).unwrap();
    }

    /// Starts the service.
    fn start(&self, ecrt: &str) -> Running {
        let mut command = Command::new(env!("CARGO_BIN_EXE_ecan"));
        command.args(["--ecrt", ecrt, "serve", "--config"]).arg(self.path("cell.toml"));
        command.args(["--socket", &self.socket()]);
        command
            .env("NOTIFY_SOCKET", self.path("notify"))
            .env("WATCHDOG_USEC", WATCHDOG.as_micros().to_string());
        Running::spawn(&mut command)
    }

    fn wait_for(&mut self, words: &str) {
        let mut buffer = [0; 4096];
        while !self.log.contains(words) {
            let count = self.notifications.recv(&mut buffer);
            let count = count.unwrap_or_else(|error| panic!("{error}: {}", self.log));
            let message = std::str::from_utf8(&buffer[..count]).unwrap();
            match message {
                "WATCHDOG=1\n" => self.pings += 1,
                message => self.log.push_str(message),
            }
        }
    }

    fn wait_for_ping(&mut self) {
        let mut buffer = [0; 4096];
        let end = self.pings + 1;
        while self.pings < end {
            let count = self.notifications.recv(&mut buffer).unwrap();
            self.pings += usize::from(&buffer[..count] == b"WATCHDOG=1\n");
        }
    }
}

#[test]
fn service_manager_receives_state_pings_and_end() {
    let mut manager = Manager::new(FILE);
    let mut program = manager.start("sim");
    manager.wait_for("READY=1\nSTATUS=1 of 1 gateways ready\n");
    manager.wait_for_ping();
    let client = Client::connect(&manager.path("bus.sock"), "test").unwrap();
    manager.log.clear();
    let fault = json!({ "kind": "power_cycle", "gateway": 0, "off_ms": 100 });
    client.call("sim.fault", fault).unwrap();
    manager.wait_for("STATUS=0 of 1 gateways ready; not ready: slave 0\n");
    program.wait_for_error("slave 0: lost");
    manager.wait_for("STATUS=1 of 1 gateways ready\n");
    program.terminate();
    manager.wait_for("STOPPING=1\n");
    assert_eq!(program.wait().0, Some(0));
}

/// A debugger stops the thread of the cycle, and this thread only.
#[test]
fn stuck_cycle_ends_the_pings_of_the_watchdog() {
    let mut manager = Manager::new(FILE);
    let mut program = manager.start("sim");
    manager.wait_for("READY=1\n");
    manager.wait_for_ping();
    let cycle = Pid::from_raw(program.id().try_into().unwrap());
    if let Err(error) = ptrace::seize(cycle, ptrace::Options::empty()) {
        eprintln!("skipped: this system does not permit ptrace: {error}");
        return;
    }
    ptrace::interrupt(cycle).unwrap();
    manager.notifications.set_read_timeout(Some(WATCHDOG * 2)).unwrap();
    while manager.notifications.recv(&mut [0; 4096]).is_ok() {}
    manager.notifications.set_read_timeout(Some(LIMIT)).unwrap();
    ptrace::detach(cycle, None).unwrap();
    manager.wait_for_ping();
    program.end();
}

#[test]
fn gateway_that_is_plugged_in_later_is_started() {
    let mut manager = Manager::new(FILE);
    let off = "[[gateway]]\n[[fault]]\nkind = \"power_off\"\ngateway = 0\nat_ms = 1\n";
    let bus = scenario(off);
    let mut program = manager.start(&setting(&bus));
    manager.wait_for("READY=1\n");
    assert!(!manager.log.contains("1 of 1"), "{}", manager.log);
    let client = Client::connect(&manager.path("bus.sock"), "test").unwrap();
    client.call("sim.fault", json!({ "kind": "power_on", "gateway": 0 })).unwrap();
    manager.wait_for("STATUS=1 of 1 gateways ready\n");
    program.end();
}

#[test]
fn service_manager_that_does_not_read_delays_nothing() {
    let manager = Manager::new(FILE);
    let mut program = manager.start("sim");
    program.wait_for_error("slave 0: ready");
    let client = Client::connect(&manager.path("bus.sock"), "test").unwrap();
    // The system keeps about ten messages.
    for _ in 0..10 {
        let fault = json!({ "kind": "power_cycle", "gateway": 0, "off_ms": 10 });
        client.call("sim.fault", fault).unwrap();
        program.signal(Signal::HUP);
    }
    assert_eq!(client.slaves().unwrap().len(), 1);
    program.end();
}

#[test]
fn missing_master_is_waited_for() {
    let mut manager = Manager::new(&format!("master = 3\n{FILE}"));
    let mut program = manager.start("sim");
    manager.wait_for("STATUS=EtherCAT master 3 is not available");
    manager.wait_for("next attempt in 2 s");
    program.end();
    let message = fails(3, &["--ecrt", "/none/lib.so", "serve", "--socket", &manager.socket()]);
    assert!(message.contains("/none/lib.so"), "{message}");
}

#[test]
fn termination_ends_a_start_that_waits() {
    let manager = Manager::new(FILE);
    let silent = "[[gateway]]\n[[fault]]\nkind = \"mailbox_timeout\"\ngateway = 0\nat_ms = 0\n\
                  for_ms = 4000000000\n";
    let bus = scenario(silent);
    let mut program = manager.start(&setting(&bus));
    program.wait_for_error("serving master 0");
    program.end();
    assert!(!manager.path("bus.sock").exists());
}

#[test]
fn idle_service_is_ready_at_once() {
    let mut manager = Manager::new(FILE);
    let mut command = Command::new(env!("CARGO_BIN_EXE_ecan"));
    command.args(["--ecrt", "sim", "serve", "--idle", "--socket", &manager.socket()]);
    command.env("NOTIFY_SOCKET", manager.path("notify"));
    let mut program = Running::spawn(&mut command);
    manager.wait_for("READY=1\nSTATUS=no cycle");
    program.end();
}

/// Runs `ecan serve` with sockets as file descriptors from 3 on.
fn with_passed(manager: &Manager, sockets: usize, options: &str) -> (Running, UnixListener) {
    let listener = UnixListener::bind(manager.path("bus.sock")).unwrap();
    let script = format!(
        "export LISTEN_PID=$$ LISTEN_FDS={sockets}; exec \"$0\" --ecrt sim serve --idle {options} \
         3<&0 4<&0 </dev/null"
    );
    let mut command = Command::new("sh");
    command.args(["-c", &script, env!("CARGO_BIN_EXE_ecan")]);
    command.stdin(Stdio::from(std::os::fd::OwnedFd::from(listener.try_clone().unwrap())));
    (Running::spawn(&mut command), listener)
}

#[test]
fn passed_socket_is_used_and_kept() {
    let manager = Manager::new(FILE);
    let (mut program, listener) = with_passed(&manager, 1, "");
    let client = Client::connect(&manager.path("bus.sock"), "test").unwrap();
    assert_eq!(client.slaves().unwrap().len(), 1);
    program.wait_for_error(&format!("serving master 0 at {}", manager.socket()));
    program.end();
    assert!(manager.path("bus.sock").exists(), "the file is of the service manager");
    drop(listener);
}

#[test]
fn other_passed_sockets_are_rejected() {
    for (sockets, options, words) in
        [(2, "", "it passes 2"), (1, "--socket x.sock", "remove --socket")]
    {
        let manager = Manager::new(FILE);
        let (mut program, _listener) = with_passed(&manager, sockets, options);
        assert_has(&program.ends(2), words);
    }
}

/// The user of a unit need not be root, and has no `XDG_RUNTIME_DIR`.
#[test]
fn folder_of_the_unit_has_the_socket() {
    let manager = Manager::new(FILE);
    let mut command = Command::new(env!("CARGO_BIN_EXE_ecan"));
    command.args(["--ecrt", "sim", "serve", "--idle"]);
    command.env("RUNTIME_DIRECTORY", manager.directory.path()).env_remove("XDG_RUNTIME_DIR");
    let mut program = Running::spawn(&mut command);
    let socket = manager.path("master0.sock");
    program.wait_for_error(&format!("serving master 0 at {}", socket.display()));
    Client::connect(&socket, "test").unwrap();
    program.end();
}

#[test]
fn hang_up_applies_what_it_can_and_names_the_rest() {
    let mut manager = Manager::new(FILE);
    let mut program = manager.start("sim");
    manager.wait_for("STATUS=1 of 1 gateways ready\n");
    program.signal(Signal::HUP);
    program.wait_for_error("cell.toml: no setting of the gateways differs");
    let limits = "paced = false\nhold_limit = 20\n";
    manager.write(&format!(
        "cycle_us = 2000\n[service]\nread_only = true\nmax_clients = 7\n[[gateway]]\nn = 3\n{limits}\
         can0 = {{ bitrate = 250_000 }}\n"
    ));
    let client = Client::connect(&manager.path("bus.sock"), "test").unwrap();
    let fault = json!({ "kind": "power_on", "gateway": 0 });
    client.call("sim.fault", fault.clone()).unwrap();
    program.signal(Signal::HUP);
    program.wait_for_error("reload: read-only, at most 7 clients: active now");
    program.wait_for_error("cycle: 10000 us -> 2000 us: needs `ecan config apply");
    program.wait_for_error("gateway[0].can0.nominal_bitrate: 500000 -> 250000: needs");
    program.wait_for_error("gateway[0].hold_limit: 10 -> 20: active now");
    program.wait_for_error("gateway[0].paced: true -> false: active now");
    // The thread of the service takes it over in its next round.
    let mut error = None;
    wait_for("the new permission", || {
        error = client.call("sim.fault", fault.clone()).err();
        error.is_some()
    });
    assert!(error.unwrap().to_string().contains("read-only"));
    manager.wait_for("RELOADING=1\nMONOTONIC_USEC=");
    manager.write("cycle_us = 2\n[[gateway]]\nn = 33\n");
    program.signal(Signal::HUP);
    program.wait_for_error("reload: nothing was changed: ");
    program.wait_for_error("line 3, column 5: `n` = 33 is out of range");
    manager.wait_for("STATUS=1 of 1 gateways ready; the last reload failed\n");
    let errors = program.end();
    assert!(!errors.contains("lost"), "the gateway left OP: {errors}");
}

#[test]
fn killed_service_is_replaced_over_its_socket() {
    let mut served = serve(&["--idle"]);
    served.program.kill();
    assert!(Path::new(&served.path).exists(), "a stale socket");
    let mut second =
        Running::start(&["--ecrt", "sim", "serve", "--idle", "--socket", &served.path]);
    second.wait_for_error("serving master 0");
    assert_eq!(served.client().slaves().unwrap().len(), 1);
    second.end();
}

#[test]
fn removed_socket_is_created_again() {
    let served = serve(&["--idle"]);
    std::fs::remove_file(&served.path).unwrap();
    let has_client = || Client::connect(Path::new(&served.path), "test").is_ok();
    wait_for("the new socket", has_client);
    served.end();
}

#[test]
fn unit_starts_the_program_with_valid_options() {
    let directory = Path::new(env!("CARGO_MANIFEST_DIR")).join("systemd");
    let unit = std::fs::read_to_string(directory.join("ecan-serve@.service")).unwrap();
    let start = unit.lines().find_map(|line| line.strip_prefix("ExecStart=/usr/local/bin/ecan "));
    let start = start.unwrap().replace("%i", "0");
    let arguments: Vec<_> = start.split(' ').chain(["--help"]).collect();
    assert!(good(&arguments).contains("ecan serve"));
    // Options, file, host: a restart does not help. The drop-in opens what `--metrics` needs.
    assert!(unit.contains("\nRestartPreventExitStatus=2 6 7\n"));
    assert!(unit.contains("\nRestrictAddressFamilies=AF_UNIX\n"));
    let drop_in = std::fs::read_to_string(directory.join("metrics-tcp.conf")).unwrap();
    assert!(drop_in.ends_with("\n[Service]\nRestrictAddressFamilies=AF_INET AF_INET6\n"));
    let socket = std::fs::read_to_string(directory.join("ecan-serve@.socket")).unwrap();
    assert!(
        socket.contains("ListenStream=/run/ecan/master%i.sock\n"),
        "the default of the program"
    );
}
