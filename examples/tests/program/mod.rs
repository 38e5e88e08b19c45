//! Running the example programs as a user does.
#![allow(dead_code, missing_docs)]

pub mod master_faults;

use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

use ecan_test_support::Killed;

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
    ecan_test_support::output(&mut command(program, arguments))
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

/// Checks runs that fail: further arguments, words of the message.
#[track_caller]
pub fn all_fail(program: &str, base: &[&str], cases: &[(&[&str], &str)]) {
    for (arguments, words) in cases {
        let message = fails(program, &[base, *arguments].concat());
        assert!(message.contains(words), "{arguments:?}: {message}");
    }
}

/// Checks that a text has all of these parts.
#[track_caller]
pub fn contains_all(text: &str, parts: &[&str]) {
    for part in parts {
        assert!(text.contains(part), "{part} is not in {text}");
    }
}

/// A file in a directory of its own, and its path.
pub fn written(text: &str) -> (tempfile::TempDir, String) {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("file.toml");
    std::fs::write(&path, text).unwrap();
    let path = path.display().to_string();
    (directory, path)
}

/// Starts a program and sends SIGINT after a line with `words`; expects success, and returns the output
/// after that line.
pub fn interrupt_after(mut command: Command, words: &str) -> String {
    let mut child = Killed::spawn(command.stdout(Stdio::piped()));
    let mut lines = child.lines();
    assert!(lines.any(|line| line.contains(words)), "it ended without a signal");
    let id = child.id().to_string();
    assert!(Command::new("kill").args(["-INT", &id]).status().unwrap().success());
    let rest: String = lines.map(|line| line + "\n").collect();
    assert!(child.output().status.success(), "{rest}");
    rest
}
