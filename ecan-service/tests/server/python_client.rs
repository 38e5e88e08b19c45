//! The Python example prints frames of a service and sends one. Skipped without Python.

use std::path::Path;
use std::process::{Command, Stdio};

use super::common::Fixture;
use ecan_test_support::Killed;

#[test]
fn python_client_prints_frames_and_sends_one() {
    if !Command::new("python3")
        .arg("--version")
        .output()
        .is_ok_and(|output| output.status.success())
    {
        return println!("skipped: no python3");
    }
    let fixture = Fixture::start(|config| config.name = "bench".into());
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let mut python = Killed::spawn(
        Command::new("python3")
            .arg(root.join("examples/python/service_client.py"))
            .arg(fixture.path())
            .arg("123#1122")
            .stdout(Stdio::piped()),
    );
    let mut lines = python.lines();
    assert_eq!(lines.next().unwrap(), "# bench, master 0, access control");
    let frames: Vec<_> = lines.by_ref().take(2).collect();
    drop(fixture);
    assert_eq!(python.output().status.code(), Some(1), "the service closed the connection");
    let has = |event: &str| frames.iter().any(|line| line.contains(event));
    assert!(has(" 0.0 transmitted 123 [2] 1122 tag 1"), "{frames:?}");
    assert!(has(" 0.0 received "), "{frames:?}");
}
