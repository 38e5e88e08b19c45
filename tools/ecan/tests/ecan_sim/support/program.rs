//! Runs `ecan-sim` as a user does.

use std::io::{BufRead, BufReader, Read};
use std::process::{Child, Command, Output, Stdio};
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::time::{Duration, Instant};

use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;

/// Timeout of a failing test.
pub const DEADLINE: Duration = Duration::from_secs(300);

/// The program; its build for users if the tests are in another workspace.
fn ecan_sim() -> &'static str {
    let other = concat!(env!("CARGO_MANIFEST_DIR"), "/../../target/debug/ecan-sim");
    option_env!("CARGO_BIN_EXE_ecan-sim").unwrap_or(other)
}

pub fn command(arguments: &[&str]) -> Command {
    let mut command = Command::new(ecan_sim());
    command.args(arguments).stdin(Stdio::null());
    command
}

pub fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

pub fn run(arguments: &[&str]) -> Output {
    command(arguments).output().unwrap()
}

/// Expects failure with a readable message and returns it.
pub fn fails(output: &Output) -> String {
    let message = text(&output.stderr);
    assert!(!output.status.success(), "it succeeded");
    assert!(output.status.code().is_some(), "it was killed");
    assert!(!message.contains("panicked"), "{message}");
    assert!(!message.trim().is_empty(), "it says nothing");
    message
}

/// A child process and the lines of its standard output.
pub struct Process {
    pub child: Child,
    pub lines: Receiver<String>,
}

impl Process {
    pub fn start(command: &mut Command) -> Self {
        let mut child = command.stdout(Stdio::piped()).spawn().unwrap();
        let (sender, lines) = channel();
        let output = BufReader::new(child.stdout.take().unwrap());
        std::thread::spawn(move || {
            for line in output.lines().map_while(Result::ok) {
                if sender.send(line).is_err() {
                    break;
                }
            }
        });
        Self { child, lines }
    }

    /// Waits for the end of its output; returns the rest.
    pub fn rest(&self) -> Vec<String> {
        let start = Instant::now();
        let mut rest = Vec::new();
        loop {
            match self.lines.recv_timeout(DEADLINE.saturating_sub(start.elapsed())) {
                Ok(line) => rest.push(line),
                Err(RecvTimeoutError::Disconnected) => return rest,
                Err(RecvTimeoutError::Timeout) => panic!("it does not end: {rest:#?}"),
            }
        }
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        // A failing test leaves no process running.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// The running program.
pub struct Running {
    process: Process,
    seen: Vec<String>,
}

impl Running {
    /// Starts `ecan-sim wire` on the gateways' interface.
    pub fn start(arguments: &[&str]) -> Self {
        let base = ["wire", "--interface", super::network::GATEWAYS];
        let mut command = command(&[&base[..], arguments].concat());
        Self { process: Process::start(command.stderr(Stdio::piped())), seen: Vec::new() }
    }

    /// Waits for a line with this text.
    pub fn wait_for(&mut self, text: &str) {
        let start = Instant::now();
        while !self.seen.iter().any(|line| line.contains(text)) {
            let left = DEADLINE.saturating_sub(start.elapsed());
            match self.process.lines.recv_timeout(left) {
                Ok(line) => self.seen.push(line),
                Err(RecvTimeoutError::Timeout) => panic!("no \"{text}\": {:#?}", self.seen),
                Err(RecvTimeoutError::Disconnected) => {
                    let errors = self.errors();
                    panic!("ended without \"{text}\": {:#?} {errors}", self.seen);
                }
            }
        }
    }

    fn errors(&mut self) -> String {
        let mut errors = String::new();
        if let Some(mut stream) = self.process.child.stderr.take() {
            let _ = stream.read_to_string(&mut errors);
        }
        errors
    }

    /// Ends it with this signal; it must succeed. Returns its output.
    pub fn end(self, signal: Signal) -> String {
        kill(Pid::from_raw(self.process.child.id().try_into().unwrap()), signal).unwrap();
        self.finish()
    }

    /// Waits for its end, which must be a failure. Returns its message.
    pub fn fail(mut self) -> String {
        let start = Instant::now();
        while self.process.child.try_wait().unwrap().is_none() {
            assert!(start.elapsed() < DEADLINE, "it does not end");
            std::thread::yield_now();
        }
        assert!(!self.process.child.wait().unwrap().success());
        self.errors()
    }

    /// Waits for its end; it must succeed. Returns its output.
    pub fn finish(mut self) -> String {
        self.seen.extend(self.process.rest());
        let errors = self.errors();
        assert!(self.process.child.wait().unwrap().success(), "{errors}");
        assert_eq!(errors, "");
        self.seen.join("\n")
    }
}
