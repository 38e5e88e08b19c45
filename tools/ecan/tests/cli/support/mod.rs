//! Runs of the program.

pub mod application;
pub mod client;
pub mod observed_bus;
pub mod on_screen;
pub mod python;
pub mod terminal;
pub mod timed_reader;

use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};

use rustix::process::{Pid, Signal, kill_process};

use self::timed_reader::{LIMIT, TimedReader};
use ecan_test_support::Killed;

/// Simulated master with one gateway and echo nodes.
pub const SIM: &str = "sim";

pub fn ecan(arguments: &[&str]) -> Output {
    ecan_test_support::output(
        Command::new(env!("CARGO_BIN_EXE_ecan")).args(arguments).env_remove("ECAN_ECRT"),
    )
}

/// Standard output of a successful run.
pub fn good(arguments: &[&str]) -> String {
    let output = ecan(arguments);
    let errors = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.success(), "{arguments:?}: {errors}");
    String::from_utf8(output.stdout).unwrap()
}

/// As [`good`], on a simulated bus.
pub fn simulated(arguments: &[&str]) -> String {
    good(&[&["--ecrt", SIM][..], arguments].concat())
}

/// Error message of a run with this exit status, without the banner of a simulation.
pub fn fails(status: i32, arguments: &[&str]) -> String {
    let output = ecan(arguments);
    let errors = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(status), "{arguments:?}: {errors}");
    assert!(!errors.contains("panicked"), "{errors}");
    errors.lines().filter(|line| !line.starts_with("SIMULATED")).collect::<Vec<_>>().join("\n")
}

/// Scenario with two gateways, the second with alias 7.
pub fn two_gateways() -> tempfile::NamedTempFile {
    let file = tempfile::Builder::new().suffix(".toml").tempfile().unwrap();
    std::fs::write(file.path(), "[[gateway]]\n[[gateway]]\nalias = 7\n").unwrap();
    file
}

/// Scenario with two gateways; the mailbox of the first does not respond.
pub fn first_silent() -> tempfile::NamedTempFile {
    scenario(
        "[[gateway]]\n[[gateway]]\nalias = 7\n[[fault]]\nkind = \"mailbox_timeout\"\n\
         gateway = 0\nat_ms = 0\nfor_ms = 4000000000\n",
    )
}

/// Waits until a condition is met, at most for [`LIMIT`].
pub fn wait_for(what: &str, mut condition: impl FnMut() -> bool) {
    let end = Instant::now() + LIMIT;
    while !condition() {
        assert!(Instant::now() < end, "waited for {what}");
        std::thread::sleep(Duration::from_millis(5));
    }
}

/// Scenario file with this text.
pub fn scenario(text: &str) -> tempfile::NamedTempFile {
    let file = tempfile::Builder::new().suffix(".toml").tempfile().unwrap();
    std::fs::write(file.path(), text).unwrap();
    file
}

/// Setting of a scenario file.
pub fn setting(file: &tempfile::NamedTempFile) -> String {
    format!("sim:{}", file.path().display())
}

/// Standard output of a run with this exit status.
pub fn ends(status: i32, arguments: &[&str]) -> String {
    let output = ecan(arguments);
    let errors = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(status), "{arguments:?}: {errors}");
    String::from_utf8(output.stdout).unwrap()
}

/// Checks that a text has these words.
#[track_caller]
pub fn assert_has(text: &str, words: &str) {
    assert!(text.contains(words), "{words}: {text}");
}

/// Checks runs that fail: exit status, arguments, words of the message.
#[track_caller]
pub fn all_fail(cases: &[(i32, &[&str], &str)]) {
    for (status, arguments, words) in cases {
        assert_has(&fails(*status, arguments), words);
    }
}

/// A printed JSON document.
pub fn json_of(text: &str) -> serde_json::Value {
    serde_json::from_str(text).unwrap_or_else(|error| panic!("{error}: {text}"))
}

/// Writes a program from another process: a child of another test could inherit our descriptor, and
/// the file would be busy.
pub fn write_program(path: &std::path::Path, text: &str) {
    let status = Command::new("sh")
        .args(["-c", "printf '%s' \"$2\" > \"$1\" && chmod 755 \"$1\"", "sh"])
        .arg(path)
        .arg(text)
        .status()
        .unwrap();
    assert!(status.success());
}

/// A libethercat without a simulation, of `ecrt-sys`.
pub struct FakeLibrary(tempfile::TempDir);

impl FakeLibrary {
    /// `None` without a C compiler, with a message.
    pub fn build() -> Option<Self> {
        let sources = concat!(env!("CARGO_MANIFEST_DIR"), "/../../ecrt-sys");
        let library = Self(tempfile::tempdir().unwrap());
        let compiled = Command::new("cc")
            .args(["-shared", "-fPIC", "-I", sources, "-o", &library.path()])
            .arg(format!("{sources}/tests/fake/libethercat.c"))
            .status();
        let Ok(compiled) = compiled else {
            println!("skipped: there is no C compiler (cc)");
            return None;
        };
        assert!(compiled.success());
        Some(library)
    }

    pub fn path(&self) -> String {
        self.0.path().join("libethercat.so").display().to_string()
    }
}

/// Directory with a scenario of one gateway and these tables, and other files.
pub struct Scenario {
    directory: tempfile::TempDir,
}

impl Scenario {
    pub fn new(tables: &str) -> Self {
        let directory = tempfile::tempdir().unwrap();
        std::fs::write(directory.path().join("bus.toml"), format!("[[gateway]]\n{tables}"))
            .unwrap();
        Self { directory }
    }

    /// Replay node on channel 0, which sends one irrelevant frame and, when the gateway is ready,
    /// these frames (milliseconds, frame).
    pub fn replaying(frames: &[(u64, &str)], tables: &str) -> Self {
        let node = "[[node]]\nkind = \"replay\"\nbus = \"0.0\"\nfile = \"bus.log\"\n";
        // A second node acknowledges while the gateway is not ready.
        let silent = "[[node]]\nkind = \"silent\"\nbus = \"0.0\"\n";
        let scenario = Self::new(&format!("{node}{silent}{tables}"));
        let mut log = "(0.000000) can0 000#\n".to_owned();
        for (ms, frame) in frames {
            let ms = 8_000 + ms;
            log.push_str(&format!("({}.{:03}000) can0 {frame}\n", ms / 1000, ms % 1000));
        }
        std::fs::write(scenario.directory.path().join("bus.log"), log).unwrap();
        scenario
    }

    /// Value of `--ecrt`.
    pub fn setting(&self) -> String {
        format!("sim:{}", self.path("bus.toml"))
    }

    /// Path of a file in the directory.
    pub fn path(&self, name: &str) -> String {
        self.directory.path().join(name).display().to_string()
    }

    pub fn write(&self, name: &str, text: &str) -> String {
        let path = self.path(name);
        std::fs::write(&path, text).unwrap();
        path
    }

    pub fn read(&self, name: &str) -> String {
        std::fs::read_to_string(self.path(name)).unwrap()
    }

    /// Runs the program.
    pub fn run(&self, arguments: &[&str]) -> Output {
        ecan(&[&["--ecrt", &self.setting()][..], arguments].concat())
    }

    /// Starts the program.
    pub fn start(&self, arguments: &[&str]) -> Running {
        Running::start(&[&["--ecrt", &self.setting()][..], arguments].concat())
    }

    /// Standard output of a successful run.
    pub fn good(&self, arguments: &[&str]) -> String {
        good(&[&["--ecrt", &self.setting()][..], arguments].concat())
    }

    /// Error message of a run with this exit status.
    pub fn fails(&self, status: i32, arguments: &[&str]) -> String {
        fails(status, &[&["--ecrt", &self.setting()][..], arguments].concat())
    }
}

/// Running program; killed when dropped.
pub struct Running {
    child: Killed,
    stdout: Option<TimedReader>,
    stderr: TimedReader,
}

impl Running {
    pub fn start(arguments: &[&str]) -> Self {
        Self::spawn(Command::new(env!("CARGO_BIN_EXE_ecan")).args(arguments))
    }

    /// As [`spawn`](Self::spawn), with a pipe as standard input.
    pub fn spawn_with_input(command: &mut Command) -> (Self, std::process::ChildStdin) {
        let mut running = Self::spawn(command.stdin(Stdio::piped()));
        let input = running.child.stdin.take().unwrap();
        (running, input)
    }

    pub fn spawn(command: &mut Command) -> Self {
        let command = command.env_remove("ECAN_ECRT").stdout(Stdio::piped());
        let mut child = Killed::spawn(command.stderr(Stdio::piped()));
        let stdout = child.stdout.take().map(TimedReader::new);
        let stderr = TimedReader::new(child.stderr.take().unwrap());
        Self { child, stdout, stderr }
    }

    /// Next line of standard output, without line break.
    pub fn line(&mut self) -> String {
        let line = self.stdout.as_mut().unwrap().through(b'\n');
        String::from_utf8(line).unwrap().trim_end_matches('\n').to_owned()
    }

    /// Next line of standard error, without line break.
    #[cfg(feature = "zenoh")]
    pub fn error_line(&mut self) -> String {
        String::from_utf8(self.stderr.through(b'\n')).unwrap().trim_end_matches('\n').to_owned()
    }

    /// Waits for a text on standard error.
    pub fn wait_for_error(&mut self, words: &str) {
        self.stderr.wait_for(words);
    }

    /// Reads what arrives on standard error within a time.
    pub fn read_errors(&mut self, time: Duration) {
        self.stderr.read_during(time);
    }

    /// Standard error until here.
    pub fn errors(&self) -> String {
        self.stderr.text()
    }

    /// Closes standard output.
    pub fn close_stdout(&mut self) {
        self.stdout = None;
    }

    pub fn terminate(&mut self) {
        self.signal(Signal::TERM);
    }

    pub fn id(&self) -> u32 {
        self.child.id()
    }

    /// Returns whether it has exited.
    pub fn has_ended(&mut self) -> bool {
        self.child.try_wait().unwrap().is_some()
    }

    /// Kills it and waits for its end.
    pub fn kill(&mut self) {
        self.child.kill().unwrap();
        self.child.wait().unwrap();
    }

    /// Sends a signal.
    pub fn signal(&self, signal: Signal) {
        kill_process(Pid::from_child(&self.child), signal).unwrap();
    }

    /// Sends SIGTERM until the program exits.
    pub fn terminate_until_ended(&mut self) {
        let end = Instant::now() + LIMIT;
        while self.child.try_wait().unwrap().is_none() {
            assert!(Instant::now() < end, "no signal ended it");
            self.terminate();
            std::thread::sleep(Duration::from_millis(50));
        }
    }

    /// Ends a program that must end without an error; returns standard error.
    #[track_caller]
    pub fn end(&mut self) -> String {
        self.terminate();
        self.ends(0)
    }

    /// Standard error of a program that ends with this status.
    #[track_caller]
    pub fn ends(&mut self, status: i32) -> String {
        let (found, errors) = self.wait();
        assert_eq!(found, Some(status), "{errors}");
        errors
    }

    /// Waits for the exit: status and standard error.
    pub fn wait(&mut self) -> (Option<i32>, String) {
        let status = self.stderr.end_of(&mut self.child);
        (status.code(), self.stderr.rest())
    }
}
