//! A configuration file with CANopen nodes in a directory with its other files: what is read, and its faults.

use ecan_canopen::{NodeAddress, NodeDescription, NodeId};
use ecan_lite::config::{ConfigFileError, load, load_nodes};
use ecan_protocol::can::CanId;
use tempfile::TempDir;

pub(crate) const GRIPPER: &str = include_str!("../../../examples/network/gripper.eds");
pub(crate) const SERVO: &str = include_str!("../../../examples/network/servo_drive.eds");
pub(crate) const GATEWAY: &str = "cycle_us = 2000\n[[gateway]]\nn = 3\ncan0 = { bitrate = 1_000_000 }\n\
                       can1 = { bitrate = 500_000 }\n";

/// A directory with the device file and these files.
pub(crate) fn directory(files: &[(&str, &str)]) -> TempDir {
    let directory = tempfile::tempdir().unwrap();
    for (name, text) in [("gripper.eds", GRIPPER)].iter().chain(files) {
        let path = directory.path().join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, text).unwrap();
    }
    directory
}

pub(crate) fn nodes(text: &str) -> Vec<NodeDescription> {
    let directory = directory(&[("cell.toml", &format!("{GATEWAY}{text}"))]);
    load_nodes(directory.path().join("cell.toml")).unwrap_or_else(|error| panic!("{error}"))
}

/// Lines from the first one after [`GATEWAY`], and texts.
pub(crate) fn faults(text: &str) -> Vec<(usize, String)> {
    faults_with(text, &[])
}

pub(crate) fn faults_with(text: &str, files: &[(&str, &str)]) -> Vec<(usize, String)> {
    let directory = directory(files);
    let path = directory.path().join("cell.toml");
    std::fs::write(&path, format!("{GATEWAY}{text}")).unwrap();
    match load(&path) {
        Err(ConfigFileError::Faults { faults, .. }) => {
            let lines = GATEWAY.lines().count();
            faults
                .0
                .into_iter()
                .map(|fault| (fault.line.saturating_sub(lines), fault.reason))
                .collect()
        }
        other => panic!("{other:?}"),
    }
}

/// Checks that a fault has these words.
#[track_caller]
pub(crate) fn has(found: &[(usize, String)], words: &str) {
    assert!(found.iter().any(|fault| fault.1.contains(words)), "{words}: {found:#?}");
}

pub(crate) fn address(channel: u8, node: u8) -> NodeAddress {
    NodeAddress { slave: 0, channel, node: NodeId::new(node).unwrap() }
}

pub(crate) fn id(raw: u16) -> CanId {
    CanId::standard(raw).unwrap()
}
