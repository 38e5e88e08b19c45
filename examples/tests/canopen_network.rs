//! The network of examples/network on the simulator, as a user runs it.

use std::path::Path;
use std::process::Output;

use crate::program::{command, contains_all};

fn run(arguments: &[&str]) -> Output {
    let directory = Path::new(env!("CARGO_MANIFEST_DIR")).join("network");
    command("canopen_network", arguments).current_dir(directory).output().unwrap()
}

/// A copy of the files of the network, and the text of the machine.
fn copied() -> (tempfile::TempDir, String) {
    let directory = tempfile::tempdir().unwrap();
    let files = Path::new(env!("CARGO_MANIFEST_DIR")).join("network");
    for file in ["servo_drive.eds", "gripper.eds", "simulated.toml"] {
        std::fs::copy(files.join(file), directory.path().join(file)).unwrap();
    }
    (directory, std::fs::read_to_string(files.join("machine.toml")).unwrap())
}

#[test]
fn network_boots_and_moves_from_files_only() {
    let output = run(&["machine.toml", "--ecrt", "sim:simulated.toml"]);
    let (text, errors) =
        (String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
    assert!(output.status.success(), "{text}{errors}");
    let parts = [
        "SIMULATED",
        "gripper, node 4 (slave 0, channel 1): writing parameters, 1 of 1, 0x2000:00 (Grip force)",
        "gripper, node 4 (slave 0, channel 1): booted after",
        "axis 1, node 2 (slave 0, channel 0): following targets",
        "stopped",
    ];
    contains_all(&text, &parts);
}

#[test]
fn another_device_is_named() {
    let (directory, text) = copied();
    let path = directory.path().join("machine.toml");
    std::fs::write(
        &path,
        text.replace("name = \"gripper\"", "name = \"gripper\"\nserial_number = 5"),
    )
    .unwrap();
    let setting = format!("sim:{}", directory.path().join("simulated.toml").display());
    let output = run(&[path.to_str().unwrap(), "--ecrt", &setting]);
    let text = String::from_utf8_lossy(&output.stdout);
    assert_eq!(output.status.code(), Some(1), "{text}");
    let expected = "gripper, node 4 (slave 0, channel 1): boot-up failed (status O): serial number";
    assert!(text.contains(expected), "{text}");
}

#[test]
fn network_without_axes_is_served() {
    let (directory, text) = copied();
    let (before, rest) = text.split_once("[[node]]").unwrap();
    let gripper = &rest[rest.find("name = \"gripper\"").unwrap()..];
    let path = directory.path().join("nodes.toml");
    std::fs::write(&path, format!("{before}[[node]]\n{gripper}")).unwrap();
    let setting = format!("sim:{}", directory.path().join("simulated.toml").display());
    let output = run(&[path.to_str().unwrap(), "--ecrt", &setting, "--cycles", "50"]);
    let (text, errors) =
        (String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
    assert!(output.status.success(), "{text}{errors}");
    let booted = "gripper, node 4 (slave 0, channel 1): booted after";
    contains_all(&text, &["1 nodes, 0 axes", booted, "stopped"]);
}
