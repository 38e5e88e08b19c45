//! `ecan node sdo`: objects by number and name, with and without a device file.

use serde_json::Value;

use crate::serve::serve_bus;
use crate::support::{Scenario, assert_has, fails, good, json_of};

fn sdo(arguments: &[&str]) -> String {
    good(&[&["--ecrt", "sim:drives", "node", "sdo"], arguments].concat())
}

fn sdo_fails(status: i32, arguments: &[&str]) -> String {
    fails(status, &[&["--ecrt", "sim:drives", "node", "sdo"], arguments].concat())
}

#[test]
fn objects_are_read_by_number_and_name() {
    for (object, expected) in [
        ("0x6064", "0x6064:00 position actual value = 1007\n"),
        ("position actual value", "0x6064:00 position actual value = 1007\n"),
        ("0x1018:4", "0x1018:04 identity/serial number = 1008 (0x3F0)\n"),
        ("identity:product", "0x1018:02 identity/product code = 402 (0x192)\n"),
        ("0x1008", "0x1008:00 device name = \"ECAN simulated servo drive\"\n"),
        ("0x6041", "0x6041:00 statusword = 576 (0x240): switch on disabled\n"),
        ("0x1000", "0x1000:00 device type = 131474 (0x20192): servo drive (CiA 402)\n"),
        ("0x2001", "0x2001:00 = 73 69 6D 75 6C 61 74 65 64\n"),
    ] {
        assert_eq!(sdo(&["read", "--node", "1", object]), expected);
    }
    assert_eq!(
        sdo(&["read", "--node", "1", "--type", "string", "0x2001"]),
        "0x2001:00 = \"simulated\"\n"
    );
    let read =
        good(&["--json", "--ecrt", "sim:drives", "node", "sdo", "read", "--node", "3.4", "0x6064"]);
    let read = json_of(&read);
    assert_eq!((&read["channel"], &read["node"]), (&3.into(), &4.into()));
    assert_eq!((&read["value"], &read["type"]), (&34_007.into(), &"i32".into()));
    assert_eq!(read["bytes"], Value::from(34_007_i32.to_le_bytes().to_vec()));
}

#[test]
fn written_object_is_read_again() {
    assert_eq!(
        sdo(&["write", "--node", "1", "producer heartbeat time", "500"]),
        "0x1017:00 producer heartbeat time = 500 (0x1F4)\n"
    );
    assert_eq!(sdo(&["write", "--node", "1", "0x607C", "-12"]), "0x607C:00 home offset = -12\n");
    assert_eq!(
        sdo(&["write", "--node", "1", "--yes", "0x6060", "8"]),
        "0x6060:00 modes of operation = 8: CSP\n"
    );
    // Longer than one frame, and longer than the limit of block transfer.
    for count in [7, 64, 300] {
        let bytes: Vec<String> = (0..count).map(|nth| format!("{:02X}", nth % 251)).collect();
        let bytes = bytes.join(" ");
        let printed = sdo(&["write", "--node", "1", "--type", "bytes", "0x2000", &bytes]);
        assert_eq!(printed, format!("0x2000:00 = {bytes}\n"));
    }
}

#[test]
fn invalid_objects_and_values_are_rejected_before_the_bus() {
    for (arguments, expected) in [
        (&["read", "--node", "1", "nonsense"][..], "no object `nonsense`"),
        (&["read", "--node", "1", "0x10000"], "allowed: 0 to 0xFFFF"),
        (&["write", "--node", "1", "0x1017", "70000"], "70000 is out of range for UNSIGNED16"),
        (&["write", "--node", "1", "0x1017", "half"], "is not a number"),
        (&["write", "--node", "1", "0x2002", "1"], "set it with --type, or use a device file"),
        (&["write", "--node", "1", "--type", "u7", "0x2002", "1"], "possible values"),
    ] {
        let message = sdo_fails(2, arguments);
        assert!(message.contains(expected), "{arguments:?}: {message}");
    }
}

#[test]
fn rejection_of_the_node_has_its_abort_code() {
    let message = sdo_fails(5, &["read", "--node", "1", "0x5000"]);
    assert!(message.contains("SDO upload 0x5000:00 from node 1 (slave 0, channel 0)"), "{message}");
    assert!(message.contains("0x06020000"), "{message}");
    let message = sdo_fails(5, &["write", "--node", "1", "0x1008", "new name"]);
    assert!(
        message.contains("SDO download 0x1008:00") && message.contains("0x06010002"),
        "{message}"
    );
}

#[test]
fn list_shows_the_objects_that_the_node_has() {
    let all = sdo(&["list", "--node", "1"]);
    let has = |number: &str| all.lines().any(|line| line.starts_with(number));
    assert!(has("0x1018:04") && has("0x6502:00") && has("0x1A03:02"), "{all}");
    assert!(!has("0x6402:00"), "the drive has no motor type: {all}");
    let identity = sdo(&["list", "--node", "1", "identity"]);
    let lines: Vec<_> = identity.lines().collect();
    assert_eq!(lines.len(), 6, "{identity}");
    assert_eq!(
        lines[2],
        "0x1018:01  u32   -       identity/vendor-ID         1397312768 (0x53494D00)"
    );
    // Names need no bus.
    let names = good(&["node", "sdo", "list", "--node", "1", "--names", "statusword"]);
    assert_eq!(names.lines().last(), Some("0x6041:00  u16   -       statusword"));
}

const EDS: &str = "[FileInfo]\nFileName=demo.eds\n[DeviceInfo]\nVendorName=ECAN\nVendorNumber=0x53494D00\n\
ProductName=demo\nProductNumber=402\n[MandatoryObjects]\nSupportedObjects=1\n1=0x1000\n[1000]\n\
ParameterName=Device type\nObjectType=0x7\nDataType=0x7\nAccessType=ro\n[OptionalObjects]\n\
SupportedObjects=2\n1=0x1017\n2=0x6064\n[1017]\nParameterName=Heartbeat period\nObjectType=0x7\n\
DataType=0x6\nAccessType=rw\n[6064]\nParameterName=Where it is\nObjectType=0x7\nDataType=0x4\n\
AccessType=ro\n[ManufacturerObjects]\nSupportedObjects=2\n1=0x2001\n2=0x2100\n[2001]\n\
ParameterName=Demo text\nObjectType=0x7\nDataType=0x9\nAccessType=rw\n[2100]\n\
ParameterName=Missing\nObjectType=0x7\nDataType=0x5\nAccessType=rw\n";

#[test]
fn device_file_gives_names_types_and_access() {
    let files = Scenario::new("");
    let eds = files.write("demo.eds", EDS);
    let run = |arguments: &[&str]| sdo(&[arguments, &["--node", "1", "--eds", &eds]].concat());
    assert_eq!(run(&["read", "demo text"]), "0x2001:00 Demo text = \"simulated\"\n");
    assert_eq!(run(&["read", "where it is"]), "0x6064:00 Where it is = 1007\n");
    assert_eq!(run(&["write", "demo", "hello"]), "0x2001:00 Demo text = \"hello\"\n");
    let list = run(&["list"]);
    let line = |number: &str| list.lines().find(|line| line.starts_with(number)).unwrap();
    assert_eq!(list.lines().count(), 6, "{list}");
    assert!(line("0x1017:00").contains("u16     rw      Heartbeat period  0"), "{list}");
    assert!(line("0x2100:00").contains("aborted by the node: 0x06020000"), "{list}");
    let message = sdo_fails(2, &["write", "--node", "1", "--eds", &eds, "where it is", "5"]);
    assert!(message.contains("cannot be written: its access is ro"), "{message}");
    let info = good(&["--ecrt", "sim:drives", "node", "info", "--node", "1", "--eds", &eds]);
    assert!(info.contains("demo.eds: identity matches"), "{info}");
}

#[test]
fn unsuitable_device_file_is_reported() {
    let files = Scenario::new("");
    let other = files.write("other.eds", &EDS.replace("ProductNumber=402", "ProductNumber=403"));
    let arguments = ["--ecrt", "sim:drives", "node", "info", "--node", "1", "--eds", &other];
    assert_has(&fails(1, &arguments), "problems found; see the report above");
    let empty = files.write("empty.eds", "[FileInfo]\n");
    let message = sdo_fails(6, &["read", "--node", "1", "--eds", &empty, "0x1000"]);
    assert!(message.contains("cannot use ") && message.contains("empty.eds"), "{message}");
    let message = sdo_fails(6, &["read", "--node", "1", "--eds", "/no/such.eds", "0x1000"]);
    assert!(message.contains("cannot read /no/such.eds"), "{message}");
}

/// A configuration file with two gateways, and nodes with names.
fn named_nodes(files: &Scenario) -> String {
    files.write("demo.eds", EDS);
    files.write(
        "machine.toml",
        "cycle_us = 2000\n[[gateway]]\nn = 3\ncan0 = { bitrate = 500_000 }\n\
         [[gateway]]\nposition = 1\nn = 3\ncan2 = { bitrate = 500_000 }\n\
         [[node]]\nname = \"left\"\ngateway = 0\nchannel = 0\nnode = 1\ncheck_identity = false\n\
         [[node]]\nname = \"Gripper\"\ngateway = 1\nchannel = 2\nnode = 7\nheartbeat_ms = 0\n\
         device_file = \"demo.eds\"\nrpdo = []\n\
         [[node]]\nname = \"left\"\ngateway = 1\nchannel = 2\nnode = 9\n",
    )
}

const TWO: &str =
    "[[gateway]]\n[[node]]\nkind = \"drive\"\nname = \"a\"\nbus = \"1.2\"\nnode_id = 7\n";

#[test]
fn node_is_selected_by_its_name_in_the_configuration() {
    let scenario = Scenario::new(TWO);
    let config = named_nodes(&scenario);
    let run = |arguments: &[&str]| scenario.good(&[&["node"], arguments].concat());
    let info = run(&["info", "gripper", "--config", &config]);
    assert!(info.contains("node            7 on can2 of slave 1\n"), "{info}");
    assert!(info.contains("device file     demo.eds: identity matches\n"), "{info}");
    let read = ["sdo", "read", "demo text", "--node", "GRIPPER", "--config", &config];
    assert_eq!(run(&read), "0x2001:00 Demo text = \"simulated\"\n", "names of its device file");
    for (arguments, expected) in [
        (&["gripper"][..], "the node \"gripper\" needs the configuration file"),
        (&["arm", "--config", &config], "has no node \"arm\"; allowed: left, Gripper, left"),
        (&["left", "--config", &config], "has several nodes \"left\": node 1 (slave 0, channel 0)"),
        (&["gripper", "--channel", "1", "--config", &config], "name different channels"),
        (&["gripper", "--config", &config, "--slave", "0"], "file states the gateway"),
        (&["--config", &config], "required arguments were not provided"),
    ] {
        let message = scenario.fails(2, &[&["node", "info"], arguments].concat());
        assert!(message.contains(expected), "{arguments:?}: {message}");
    }
}

#[test]
fn service_accepts_the_names_of_a_configuration() {
    let scenario = Scenario::new(TWO);
    let config = named_nodes(&scenario);
    let mut served = serve_bus(&scenario.setting(), &[]);
    served.program.wait_for_error("slave 1: ready");
    let via = ["--via", served.path.as_str(), "node"];
    let info = good(&[&via[..], &["info", "gripper", "--config", &config]].concat());
    assert!(info.contains("node            7 on can2 of slave 1\n"), "{info}");
    served.end();
}
