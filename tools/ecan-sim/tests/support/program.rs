//! Runs `ecan-sim` as a user does.

use std::io::{BufRead, BufReader, Read};
use std::process::{Child, Command, Output, Stdio};
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::time::{Duration, Instant};

use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;

/// Timeout of a failing test.
pub const DEADLINE: Duration = Duration::from_secs(60);

pub fn command(arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_ecan-sim"));
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

/// The running program.
pub struct Running {
    child: Child,
    lines: Receiver<String>,
    seen: Vec<String>,
}

impl Running {
    /// Starts `ecan-sim wire` on the gateways' interface.
    pub fn start(arguments: &[&str]) -> Self {
        let base = ["wire", "--interface", super::network::GATEWAYS];
        let mut child = command(&[&base[..], arguments].concat())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let (sender, lines) = channel();
        let output = BufReader::new(child.stdout.take().unwrap());
        std::thread::spawn(move || {
            for line in output.lines().map_while(Result::ok) {
                if sender.send(line).is_err() {
                    break;
                }
            }
        });
        Self { child, lines, seen: Vec::new() }
    }

    /// Waits for a line with this text.
    pub fn wait_for(&mut self, text: &str) {
        let start = Instant::now();
        while !self.seen.iter().any(|line| line.contains(text)) {
            let left = DEADLINE.saturating_sub(start.elapsed());
            match self.lines.recv_timeout(left) {
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
        if let Some(mut stream) = self.child.stderr.take() {
            let _ = stream.read_to_string(&mut errors);
        }
        errors
    }

    /// Ends it with this signal; it must succeed. Returns its output.
    pub fn end(self, signal: Signal) -> String {
        kill(Pid::from_raw(self.child.id().try_into().unwrap()), signal).unwrap();
        self.finish()
    }

    /// Waits for its end, which must be a failure. Returns its message.
    pub fn fail(mut self) -> String {
        let start = Instant::now();
        while self.child.try_wait().unwrap().is_none() {
            assert!(start.elapsed() < DEADLINE, "it does not end");
            std::thread::yield_now();
        }
        assert!(!self.child.wait().unwrap().success());
        self.errors()
    }

    /// Waits for its end; it must succeed. Returns its output.
    pub fn finish(mut self) -> String {
        let start = Instant::now();
        loop {
            match self.lines.recv_timeout(DEADLINE.saturating_sub(start.elapsed())) {
                Ok(line) => self.seen.push(line),
                Err(RecvTimeoutError::Disconnected) => break,
                Err(RecvTimeoutError::Timeout) => panic!("it does not end: {:#?}", self.seen),
            }
        }
        let errors = self.errors();
        assert!(self.child.wait().unwrap().success(), "{errors}");
        assert_eq!(errors, "");
        self.seen.join("\n")
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        // A failing test leaves no process behind.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
