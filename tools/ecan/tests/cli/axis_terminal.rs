//! `ecan axis` with an operator: keys of a terminal, its loss, pipes and signals.

use std::io::Write as _;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use rustix::process::Signal;

use crate::axis::{LIMITS, SCALE};
use crate::support::observed_bus::ObservedBus;
use crate::support::terminal::{Pty, is_raw, with_answer};
use crate::support::timed_reader::{LIMIT, TimedReader};
use crate::support::{Running, assert_has, scenario, wait_for};
use ecan_test_support::Killed;

const RIGHT: &[u8] = b"\x1b[C";
/// Delay of the first repetition of a held key, and interval of the others.
const FIRST_REPEAT: Duration = Duration::from_millis(300);
const REPEAT: Duration = Duration::from_millis(35);
/// Only a gap of a second between two repetitions counts as a release: the machine may be busy.
const PATIENT: [&str; 2] = ["--key-timeout", "1000"];

/// A program whose standard input is a terminal.
struct Operated {
    running: Running,
    pty: Pty,
}

fn arguments<'a>(setting: &'a str, command: &'a str, more: &[&'a str]) -> Vec<&'a str> {
    let start = ["--ecrt", setting, "axis", command, "--cycle-us", "2000", "--yes"];
    [&start[..], &SCALE, &LIMITS, more].concat()
}

impl Operated {
    fn start(command: &str, more: &[&str]) -> Self {
        Self::spawn(&[env!("CARGO_BIN_EXE_ecan")], command, more)
    }

    /// As a session leader, which gets SIGHUP when its terminal closes.
    fn start_leader(command: &str, more: &[&str]) -> Self {
        Self::spawn(&["setsid", "--ctty", env!("CARGO_BIN_EXE_ecan")], command, more)
    }

    fn spawn(program: &[&str], command: &str, more: &[&str]) -> Self {
        let pty = Pty::open((80, 24));
        let line = [program, &arguments("sim:drives", command, more)].concat();
        let mut command = Command::new(line[0]);
        command.args(&line[1..]).env("TERM", "xterm").stdin(pty.stdio());
        Self { running: Running::spawn(&mut command), pty }
    }

    fn press(&mut self, keys: &[u8]) {
        self.pty.master.write_all(keys).unwrap();
    }

    /// Holds a key until something has happened, as a terminal repeats it. On a busy machine the program may take
    /// the key for released, and begins again.
    fn hold_until(&mut self, key: &[u8], mut is_done: impl FnMut(&Running) -> bool) {
        self.press(key);
        std::thread::sleep(FIRST_REPEAT);
        let end = Instant::now() + LIMIT;
        while !is_done(&self.running) {
            let is_waiting = Instant::now() < end && !self.running.has_ended();
            assert!(is_waiting, "{}", self.running.errors());
            self.press(key);
            self.running.read_errors(REPEAT);
        }
    }

    /// Holds a key until a text is on standard error.
    fn hold_until_error(&mut self, key: &[u8], text: &str) {
        self.hold_until(key, |running| running.errors().contains(text));
    }

    /// Presses a key and waits until the program has read it.
    fn press_once(&mut self, key: &[u8]) {
        self.press(key);
        let end = Instant::now() + LIMIT;
        while rustix::io::ioctl_fionread(&self.pty.terminal).unwrap() > 0 {
            assert!(Instant::now() < end, "{}", self.running.errors());
            std::thread::yield_now();
        }
    }

    /// Closes the terminal.
    fn close(self) -> Running {
        let Self { running, pty } = self;
        drop(pty);
        running
    }

    /// Waits for the end: status and standard error. Checks that the terminal is restored.
    fn ends(mut self, status: i32) -> String {
        let errors = self.running.ends(status);
        assert!(!is_raw(&self.pty.terminal), "the terminal is not restored: {errors}");
        errors
    }
}

/// Position in the last line, in degrees.
fn last_position(errors: &str) -> f64 {
    let line = errors.lines().rfind(|line| line.contains(", at ")).unwrap();
    let position = line.rsplit_once(", at ").unwrap().1.trim_end_matches(" deg");
    position.parse().unwrap_or_else(|_| panic!("{line}"))
}

#[test]
fn held_key_moves_and_its_release_stops() {
    let (mut jog, bus) = observed_jog();
    assert!(is_raw(&jog.pty.terminal));
    jog.hold_until(RIGHT, |_| target(&bus).is_some_and(|degrees| degrees > 20.0));
    jog.running.wait_for_error("key released: quick stop");
    jog.running.wait_for_error("stopped: all axes stopped");
    jog.press(b"q");
    let errors = jog.ends(0);
    assert!(last_position(&errors) > 20.0, "{errors}");
}

#[test]
fn single_presses_enable_and_do_not_move() {
    let mut jog = Operated::start("jog", &["--key-timeout", "50"]);
    jog.running.wait_for_error("hold Left or Right");
    for _ in 0..4 {
        jog.press_once(RIGHT);
        std::thread::sleep(FIRST_REPEAT);
    }
    jog.running.wait_for_error("following targets");
    jog.running.wait_for_error("key released: quick stop");
    jog.press(b"q");
    let errors = jog.ends(0);
    assert!((last_position(&errors) - 5.532).abs() < 0.01, "{errors}");
}

#[test]
fn lost_terminal_stops_a_jog() {
    for start in [Operated::start, Operated::start_leader] {
        let mut jog = start("jog", &PATIENT);
        jog.running.wait_for_error("hold Left or Right");
        jog.hold_until_error(RIGHT, "following targets");
        let errors = jog.close().ends(1);
        let reasons = ["the terminal was closed", "SIGHUP"];
        let stopped = |axis: &&str| errors.contains(&format!("quick stop: stopped: {axis}"));
        assert!(reasons.iter().any(stopped), "{errors}");
        assert!(errors.contains("node 1 on can0: stopped, switch on disabled"), "{errors}");
    }
}

#[test]
fn lost_terminal_stops_a_move() {
    let mut moving = Operated::start("move", &["--to", "90", "--velocity", "5"]);
    moving.running.wait_for_error("moving from 5.532 deg to 90.000 deg");
    let errors = moving.close().ends(1);
    assert!(errors.contains("the terminal was closed"), "{errors}");
    assert!(errors.contains("stopped, switch on disabled"), "{errors}");
    assert!(last_position(&errors) < 80.0, "{errors}");
}

#[test]
fn any_key_stops_a_move() {
    let mut moving = Operated::start("move", &["--to", "90", "--velocity", "5"]);
    moving.running.wait_for_error("moving from");
    moving.press(b" ");
    let errors = moving.ends(1);
    assert!(errors.contains("quick stop: stopped: a key"), "{errors}");
    assert!(errors.contains("stopped, switch on disabled"), "{errors}");
}

#[test]
fn enable_ends_by_enter_and_by_the_loss_of_the_terminal() {
    let mut enabled = Operated::start("enable", &[]);
    enabled.running.wait_for_error("enabled until Enter");
    enabled.press(b"\r");
    let errors = enabled.ends(0);
    assert!((last_position(&errors) - 5.532).abs() < 0.01, "{errors}");
    let mut enabled = Operated::start("enable", &[]);
    enabled.running.wait_for_error("enabled until Enter");
    assert_has(&enabled.close().ends(1), "stopped, switch on disabled");
}

#[test]
fn enable_with_a_held_key_ends_with_its_release() {
    let mut enabled = Operated::start("enable", &[&["--hold-key"], &PATIENT[..]].concat());
    enabled.running.wait_for_error("hold a key to enable the drive");
    enabled.hold_until_error(b"x", "enabled while a key is held");
    let errors = enabled.ends(0);
    assert!(errors.contains("enabled while a key is held"), "{errors}");
    assert!(errors.contains("key released: quick stop"), "{errors}");
    assert!(errors.contains("stopped, switch on disabled"), "{errors}");
}

#[test]
fn move_with_a_held_key_ends_with_its_release() {
    let more = ["--to", "90", "--velocity", "5", "--hold-key"];
    let mut moving = Operated::start("move", &[&more[..], &PATIENT].concat());
    moving.running.wait_for_error("hold a key to enable the drive");
    moving.hold_until_error(b"x", "moving from 5.532 deg to 90.000 deg");
    let errors = moving.ends(1);
    assert!(errors.contains("moving from 5.532 deg to 90.000 deg"), "{errors}");
    assert!(errors.contains("quick stop: stopped: the key was released"), "{errors}");
    assert!(errors.contains("stopped, switch on disabled"), "{errors}");
    assert!((5.5..80.0).contains(&last_position(&errors)), "{errors}");
}

/// A drive in real time, and an slcan bridge to its bus.
pub const OBSERVED: &str = "clock = \"real\"\n[[gateway]]\n[[node]]\nkind = \"drive\"\nname = \"x\"\n\
                        bus = \"0.0\"\nnode_id = 1\n[[node]]\nkind = \"bridge\"\nbus = \"0.0\"\n\
                        protocol = \"slcan\"\naddress = \"127.0.0.1\"\nport = 0\nqueue = 60000\n";

/// Controlwords of the drive, little-endian.
fn controlwords(bus: &ObservedBus) -> Vec<String> {
    bus.frames("201").iter().filter_map(|frame| frame.get(..4).map(str::to_owned)).collect()
}

/// Last target of the drive, in degrees.
fn target(bus: &ObservedBus) -> Option<f64> {
    let frame = bus.frames("201").pop()?;
    let digits = frame.get(4..12)?;
    let steps = u32::from_str_radix(digits, 16).ok()?.swap_bytes().cast_signed();
    Some(f64::from(steps) * 360.0 / 65_536.0)
}

/// A jog that waits for a key, on an observed bus.
fn observed_jog() -> (Operated, ObservedBus) {
    let file = scenario(OBSERVED);
    let setting = crate::support::setting(&file);
    let pty = Pty::open((80, 24));
    let mut command = Command::new(env!("CARGO_BIN_EXE_ecan"));
    command.args(arguments(&setting, "jog", &PATIENT)).env("TERM", "xterm").stdin(pty.stdio());
    let mut jog = Operated { running: Running::spawn(&mut command), pty };
    jog.running.wait_for_error(" on bus ");
    let bus = ObservedBus::connect(&jog.running.errors());
    jog.running.wait_for_error("hold Left or Right");
    (jog, bus)
}

/// Controlwords after the last one that enables.
fn after_enabling(bus: &ObservedBus) -> Vec<String> {
    let all = controlwords(bus);
    let enabled = all.iter().rposition(|word| word == "0F00");
    enabled.map_or_else(Vec::new, |at| all[at + 1..].to_vec())
}

#[test]
fn lost_terminal_puts_a_quick_stop_on_the_bus() {
    let (mut jog, bus) = observed_jog();
    jog.hold_until(RIGHT, |_| target(&bus).is_some_and(|degrees| degrees > 6.0));
    jog.close().ends(1);
    // Quick stop, and nothing enables again.
    let after = after_enabling(&bus);
    assert_eq!(after.first().map(String::as_str), Some("0200"), "{:?}", controlwords(&bus));
    assert!(after.iter().all(|word| word == "0200" || word == "0000"), "{after:?}");
    // Statuswords: operation enabled, at last switch on disabled. The stop itself is shorter than a period.
    let states: Vec<_> = bus
        .frames("181")
        .iter()
        .map(|word| u8::from_str_radix(&word[..2], 16).unwrap() & 0x6F)
        .collect();
    assert!(states.contains(&0x27), "{states:?}");
    assert_eq!(states.last().map(|controlword| controlword & 0x4F), Some(0x40), "{states:?}");
}

/// A terminal that stops its output, as after Ctrl-S, blocks only the thread that prints.
#[test]
fn blocked_terminal_does_not_delay_a_stop() {
    let file = scenario(OBSERVED);
    let setting = crate::support::setting(&file);
    let (keys, screen) = (Pty::open((80, 24)), Pty::open((80, 24)));
    let mut command = Command::new(env!("CARGO_BIN_EXE_ecan"));
    command.args(arguments(&setting, "move", &["--to", "90", "--velocity", "5"]));
    command.env("TERM", "xterm").env_remove("ECAN_ECRT");
    command.stdin(keys.stdio()).stdout(Stdio::null()).stderr(screen.stdio());
    let mut child = Killed::spawn(&mut command);
    let mut shown = TimedReader::new(screen.master.try_clone().unwrap());
    shown.wait_for(" on bus ");
    let bus = ObservedBus::connect(&shown.text());
    shown.wait_for("moving from");
    // Nothing more is read: the output fills the terminal.
    fill(&screen.terminal);
    drop(keys);
    wait_for("the quick stop", || after_enabling(&bus).first().is_some_and(|word| word == "0200"));
    // Its messages are printed when the terminal continues.
    let status = shown.end_of(&mut child);
    assert_eq!(status.code(), Some(1));
}

/// Fills the output buffer of a terminal.
fn fill(terminal: &std::fs::File) {
    let flags = rustix::fs::fcntl_getfl(terminal).unwrap();
    rustix::fs::fcntl_setfl(terminal, flags | rustix::fs::OFlags::NONBLOCK).unwrap();
    while rustix::io::write(terminal, &[b' '; 256]).is_ok() {}
    rustix::fs::fcntl_setfl(terminal, flags).unwrap();
}

/// A move of 17 seconds with a pipe as standard input.
fn move_with_pipe(setting: &str) -> (Running, std::process::ChildStdin) {
    let mut command = Command::new(env!("CARGO_BIN_EXE_ecan"));
    command.args(arguments(setting, "move", &["--to", "90", "--velocity", "5"]));
    let (mut running, stdin) = Running::spawn_with_input(&mut command);
    running.wait_for_error("moving from");
    (running, stdin)
}

const REAL_TIME: &str = "clock = \"real\"\n[[gateway]]\n[[node]]\nkind = \"drive\"\nname = \"x\"\n\
                         bus = \"0.0\"\nnode_id = 1\n";

#[test]
fn closed_pipe_stops_a_move() {
    let file = scenario(REAL_TIME);
    let setting = crate::support::setting(&file);
    let (mut running, stdin) = move_with_pipe(&setting);
    drop(stdin);
    let errors = running.ends(1);
    assert!(errors.contains("quick stop: stopped: standard input was closed"), "{errors}");
    assert!(errors.contains("stopped, switch on disabled"), "{errors}");
}

#[test]
fn signals_stop_a_move() {
    let file = scenario(REAL_TIME);
    let setting = crate::support::setting(&file);
    for (signal, reason) in [
        (Signal::TERM, "Ctrl-C or SIGTERM"),
        (Signal::INT, "Ctrl-C or SIGTERM"),
        (Signal::HUP, "SIGHUP"),
    ] {
        let (mut running, _stdin) = move_with_pipe(&setting);
        running.signal(signal);
        let errors = running.ends(1);
        assert!(errors.contains(reason), "{signal:?}: {errors}");
        assert!(errors.contains("stopped, switch on disabled"), "{errors}");
    }
}

#[test]
fn question_is_answered_on_the_terminal() {
    let line =
        [&["--ecrt", "sim:drives", "axis", "move", "--to", "10"][..], &SCALE, &LIMITS].concat();
    let mut command = Command::new(env!("CARGO_BIN_EXE_ecan"));
    let (status, shown) = with_answer(command.args(&line).env_remove("ECAN_ECRT"), "n\n");
    assert_eq!(status, 2, "{shown}");
    assert!(
        shown.contains("This will move node 1 on can0, and its motor can move. Continue?"),
        "{shown}"
    );
    assert!(
        shown.contains("nothing was sent: not confirmed") && !shown.contains("configured"),
        "{shown}"
    );
}
