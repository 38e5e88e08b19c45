//! What a device file excludes: it is left out of the boot-up with a note, or is a fault before anything is sent.

use std::time::Duration;

use ecan_canopen::{DeviceFile, NodeDescription};
use ecan_lite::config::{load_axes, load_nodes, load_notes};

use super::network_files::{GATEWAY, GRIPPER, SERVO, directory, faults_with};

const NODE: &str =
    "[[node]]\nname = \"n\"\ngateway = 0\nchannel = 1\nnode = 4\ndevice_file = \"d.eds\"\n";

/// A device file without the sections of an object.
fn without(text: &str, object: &str) -> String {
    let mut is_left_out = false;
    let is_kept = |line: &&str| {
        if let Some(section) = line.strip_prefix('[') {
            is_left_out = section.starts_with(object);
        }
        !is_left_out
    };
    text.lines().filter(is_kept).flat_map(|line| [line, "\n"]).collect()
}

/// A device file whose section has another line.
fn with(text: &str, section: &str, line: (&str, &str)) -> String {
    let at = text.find(&format!("[{section}]")).unwrap();
    let (before, after) = text.split_at(at);
    let changed = before.to_owned() + &after.replacen(line.0, line.1, 1);
    assert!(changed != text, "{section}: {line:?}");
    changed
}

/// The node, and the notes except those of deviations of the changed file.
fn node_and_notes(device: &str) -> (NodeDescription, Vec<String>) {
    let directory = directory(&[("cell.toml", &*format!("{GATEWAY}{NODE}")), ("d.eds", device)]);
    let path = directory.path().join("cell.toml");
    let mut notes = load_notes(&path).unwrap();
    notes.retain(|note| !note.contains("from CiA 306; the first: line "));
    (load_nodes(&path).unwrap().remove(0), notes)
}

fn faults(more: &str, device: &str) -> Vec<String> {
    let faults = faults_with(&format!("{NODE}{more}"), &[("d.eds", device)]);
    faults.into_iter().map(|fault| fault.1).collect()
}

#[test]
fn node_without_heartbeat_producer_is_guarded_or_not_watched() {
    let (node, notes) = node_and_notes(&without(GRIPPER, "1017"));
    let guarding = node.boot.guarding.unwrap();
    assert_eq!((guarding.guard_time, node.boot.heartbeat_ms), (Duration::from_millis(100), 0));
    let start = "n: the device file has no writable object 0x1017 (heartbeat): ";
    assert_eq!(notes, [format!("{start}it is guarded every 100 ms")]);

    let (node, notes) = node_and_notes(&without(&without(GRIPPER, "1017"), "100D"));
    assert_eq!((node.boot.guarding, node.boot.heartbeat_ms), (None, 0));
    assert_eq!(notes, [format!("{start}the host does not watch it")]);

    let found = faults("heartbeat_ms = 50", &without(GRIPPER, "1017"));
    assert_eq!(
        found,
        [
            "n: heartbeat: 0x1017:00: the device file has no such object; set `heartbeat_ms` = 0, or \
                        `guard_time_ms`"
        ]
    );
    let read_only = with(GRIPPER, "1017", ("AccessType=rw", "AccessType=ro"));
    let found = faults("heartbeat_ms = 50", &read_only);
    assert!(found.len() == 1 && found[0].contains("cannot be written"), "{found:?}");
    let limited = with(GRIPPER, "1017", ("DefaultValue=0", "DefaultValue=0\nHighLimit=60"));
    let found = faults("", &limited);
    assert!(
        found.len() == 1 && found[0].contains("= 100 is out of range; allowed: 0 to 60"),
        "{found:?}"
    );
}

#[test]
fn identity_is_compared_where_the_file_states_the_same_twice() {
    let expected = |device: &str| {
        let (node, notes) = node_and_notes(device);
        ((node.boot.identity.vendor_id, node.boot.identity.product_code), notes)
    };
    assert_eq!(expected(GRIPPER), ((Some(0xABC), Some(0x42)), vec![]));
    let short = without(GRIPPER, "1018sub2").replace("[1018]", "[1018]\n;");
    assert_eq!(expected(&short), ((Some(0xABC), None), vec![]), "an entry that does not exist");
    let empty = with(GRIPPER, "1018sub1", ("DefaultValue=0x00000ABC", "DefaultValue="));
    assert_eq!(expected(&empty).0, (None, Some(0x42)));
    let zero = with(GRIPPER, "DeviceInfo", ("VendorNumber=0x00000ABC", "VendorNumber=0"));
    assert_eq!(expected(&zero).0, (None, Some(0x42)));
    let other = with(GRIPPER, "1018sub2", ("DefaultValue=0x00000042", "DefaultValue=0x43"));
    let note = "n: the product code is not compared: the device file states 0x42 in [DeviceInfo] and 0x43 in 0x1018:02";
    assert_eq!(expected(&other), ((Some(0xABC), None), vec![note.to_owned()]));
    let found = faults("product_code = 7", &short);
    let text =
        "n: product code: 0x1018:02: the device file has no such object; leave out `product_code`";
    assert_eq!(found, [text]);
}

#[test]
fn fixed_mapping_is_used_as_it_is_and_no_other_is_accepted() {
    let mut fixed = with(GRIPPER, "1A00sub0", ("DefaultValue=0", "DefaultValue=1"));
    fixed = with(&fixed, "1A00sub1", ("DefaultValue=0", "DefaultValue=0x20010020"));
    for section in ["1800sub1", "1800sub2", "1A00sub0", "1A00sub1"] {
        fixed = with(&fixed, section, ("AccessType=rw", "AccessType=const"));
    }
    DeviceFile::parse(fixed.as_bytes()).unwrap();
    let of = |more: &str| format!("[[node.tpdo]]\nnumber = 1\ntransmission = 255\n{more}");
    let text = format!("{GATEWAY}{NODE}{}", of(""));
    let directory = directory(&[("cell.toml", text.as_str()), ("d.eds", &fixed)]);
    assert_eq!(load_nodes(directory.path().join("cell.toml")).unwrap()[0].pdos.len(), 1);

    let found = faults(&of("objects = [\"Temperature\"]"), &fixed);
    let text = "cannot be written, by its device file (`AccessType`); 0x20030020 is configured; configure what the \
                device has";
    assert!(found.iter().any(|fault| fault.contains(text)), "{found:#?}");
    let found = faults(&of("inhibit_time_100us = 5"), &fixed);
    assert_eq!(
        found,
        ["n: inhibit time: 0x1800:03: the device file has no such object; leave out \
                        `inhibit_time_100us`"]
    );
}

#[test]
fn commands_and_dates_need_their_objects() {
    let text =
        "save = true\nrestore = \"all\"\nconfiguration_date = 2026-01-02T03:04:05\nsoftware = 5\n";
    let found = faults(text, GRIPPER);
    for key in ["`save`", "`restore`", "`configuration_date`", "`software`"] {
        assert!(
            found.iter().any(|fault| fault.ends_with(&format!("leave out {key}"))),
            "{key}: {found:#?}"
        );
    }
}

#[test]
fn axis_needs_the_objects_of_its_mode() {
    let node = format!("{GATEWAY}{NODE}axis = {{ step_limit = 5 }}\n");
    let axes = |device: &str| {
        let directory = directory(&[("cell.toml", node.as_str()), ("d.eds", device)]);
        load_axes(directory.path().join("cell.toml")).map_err(|error| error.to_string())
    };
    axes(SERVO).unwrap();
    axes(&without(SERVO, "60C2"))
        .unwrap_or_else(|error| panic!("tolerated by the configuration: {error}"));
    let error = axes(&without(SERVO, "6060")).unwrap_err();
    assert!(
        error.contains("n: mode CSP: 0x6060:00: the device file has no such object"),
        "{error}"
    );
    let error = faults("axis = { step_limit = 5, max_torque = 800 }", &without(SERVO, "6072"));
    assert_eq!(
        error,
        [
            "n: largest torque: 0x6072:00: the device file has no such object; leave out `max_torque`"
        ]
    );
}
