//! Running the example programs as a user does.
#![allow(dead_code, missing_docs)]

use std::io::{BufRead as _, BufReader, Read as _};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::time::Duration;

/// Time limit of a program, far above the duration of a successful test on a busy machine.
const LIMIT: Duration = Duration::from_secs(300);

/// Cargo builds the examples of a package next to its tests.
fn path(program: &str) -> PathBuf {
    let test = std::env::current_exe().unwrap();
    let profile = test.parent().and_then(Path::parent).unwrap();
    profile.join("examples").join(program)
}

pub fn command(program: &str, arguments: &[&str]) -> Command {
    let mut command = Command::new(path(program));
    command.args(arguments).env_remove("ECAN_ECRT").stdin(Stdio::null());
    command
}

pub fn run(program: &str, arguments: &[&str]) -> Output {
    command(program, arguments).output().unwrap()
}

pub fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// Runs it, expects success without messages but the faults of the scenario, and returns its output.
pub fn succeeds(program: &str, arguments: &[&str]) -> String {
    let output = run(program, arguments);
    assert!(output.status.success(), "{arguments:?}: {}", text(&output.stderr));
    let messages = text(&output.stderr);
    let other: Vec<_> = messages.lines().filter(|line| !line.contains(" s: fault: ")).collect();
    assert!(other.is_empty(), "{arguments:?}: {other:?}");
    text(&output.stdout)
}

/// Runs it, expects a readable message and failure, and returns the message.
pub fn fails(program: &str, arguments: &[&str]) -> String {
    let output = run(program, arguments);
    let message = text(&output.stderr);
    assert!(!output.status.success(), "{arguments:?} succeeded");
    assert!(output.status.code().is_some(), "{arguments:?} was killed");
    assert!(!message.contains("panicked"), "{message}");
    assert!(!message.trim().is_empty(), "{arguments:?} printed no message");
    message
}

/// A child that is killed and waited for when this is dropped.
struct Killed(Child);

impl Drop for Killed {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// Starts a program and sends SIGINT after a line with `words`; expects success, and returns the output
/// after that line. A program that does not end within [`LIMIT`] is killed.
pub fn interrupt_after(mut command: Command, words: &str) -> String {
    let mut child = Killed(command.stdout(Stdio::piped()).spawn().unwrap());
    let signal = |id: u32, name: &str| {
        assert!(Command::new("kill").args([name, &id.to_string()]).status().unwrap().success());
    };
    let id = child.0.id();
    let (_running, ended) = channel::<()>();
    std::thread::spawn(move || {
        if ended.recv_timeout(LIMIT) == Err(RecvTimeoutError::Timeout) {
            signal(id, "-KILL");
        }
    });
    let mut output = BufReader::new(child.0.stdout.take().unwrap());
    let mut line = String::new();
    while !line.contains(words) {
        line.clear();
        assert!(output.read_line(&mut line).unwrap() > 0, "it ended without a signal");
    }
    signal(id, "-INT");
    let mut rest = String::new();
    output.read_to_string(&mut rest).unwrap();
    assert!(child.0.wait().unwrap().success(), "{rest}");
    rest
}
