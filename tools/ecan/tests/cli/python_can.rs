//! python-can on `ecan bridge`: a peer that nobody wrote for it.

use std::path::Path;
use std::process::Command;

use crate::support::python::python_with;
use crate::support::{Running, Scenario};

/// An interpreter with python-can, if there is one.
fn python() -> Option<String> {
    python_with(&["can", "serial"], "python-can and pyserial")
}

#[test]
fn python_can_works_over_tcp_and_terminal() {
    let Some(python) = python() else { return };
    let directory = tempfile::tempdir().unwrap();
    let link = directory.path().join("can0").display().to_string();
    let fronts = ["--slcan", "--socketcand", "--pty", &link];
    let options = ["--ecrt", "sim", "bridge", "--data-bitrate", "2000000"];
    let mut bridge = Running::start(&[&options[..], &fronts[..]].concat());
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/cli/python/echo.py");
    for (kind, frames) in [("slcan", "6\n"), ("socketcand", "3\n"), ("terminal", "4\n")] {
        let line = bridge.line();
        let place = line.split(' ').nth(3).unwrap();
        let output =
            Command::new(&python).arg("-B").arg(&script).args([kind, place]).output().unwrap();
        let errors = String::from_utf8_lossy(&output.stderr);
        if output.stdout != frames.as_bytes() {
            bridge.terminate();
            panic!("{kind}: {errors}; the bridge: {:?}", bridge.wait());
        }
    }
    let errors = bridge.end();
    assert_eq!(errors.lines().count(), 1, "nothing but that it is simulated: {errors}");
}

/// What a script of this name prints; `program` is the interpreter.
fn run(program: &str, script: &str, arguments: &[&str]) -> String {
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/cli/python").join(script);
    let output = Command::new(program).arg("-B").arg(&script).args(arguments).output().unwrap();
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{errors}");
    String::from_utf8(output.stdout).unwrap()
}

#[test]
fn python_can_connects_to_a_busy_bus() {
    let Some(python) = python() else { return };
    let babbler = "[[node]]\nkind = \"faulty\"\nbus = \"0.0\"\nbabble_us = 300\n";
    let bus = Scenario::new(babbler);
    let mut bridge = bus.start(&["bridge", "--bitrate", "1000000", "--socketcand"]);
    let line = bridge.line();
    let place = line.split(' ').nth(3).unwrap();
    assert_eq!(run(&python, "connect.py", &[place, "30"]), "30\n");
    bridge.end();
}

/// More than fits into every queue on the way: the connection holds the client back.
#[test]
fn python_can_continues_after_full_queue() {
    let Some(python) = python() else { return };
    let mut bridge =
        Running::start(&["--ecrt", "sim", "bridge", "--bitrate", "1000000", "--socketcand"]);
    let line = bridge.line();
    let place = line.split(' ').nth(3).unwrap();
    assert_eq!(run(&python, "flood.py", &[place, "12000"]), "12000\n");
    bridge.end();
}
