//! `ecan node params`: the values of a node in a DCF, on nodes that live as long as a service.

use crate::serve::{Served, serve_bus};
use crate::support::{Scenario, assert_has, ends, json_of};

const EXAMPLE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../examples/network");

/// The machine of the example: servo drives 1 and 2 on channel 0, gripper 4 on channel 1.
fn machine() -> Served {
    let mut served = serve_bus(&format!("sim:{EXAMPLE}/simulated.toml"), &[]);
    served.program.wait_for_error("slave 0: ready");
    served
}

fn gripper<'a>(action: &'a str, file: &'a str, rest: &[&'a str]) -> Vec<&'a str> {
    const NAMED: [&str; 4] = [
        "--node",
        "gripper",
        "--config",
        concat!(env!("CARGO_MANIFEST_DIR"), "/../../examples/network/machine.toml"),
    ];
    [&["params", action, file][..], &NAMED, rest].concat()
}

fn values(path: &str) -> Vec<String> {
    let text = std::fs::read_to_string(path).unwrap();
    text.lines().filter(|line| line.starts_with("ParameterValue=")).map(str::to_owned).collect()
}

#[test]
fn saved_values_are_compared_and_restored() {
    let served = machine();
    let eds = format!("{EXAMPLE}/gripper.eds");
    let write = |object: &str, value: &str| {
        served.node(&["sdo", "write", "--node", "1.4", "--eds", &eds, object, value])
    };
    let file = served.path_of("gripper.dcf");
    write("grip force", "120");
    write("label", "left");
    write("0x1017", "250");
    let saved = served.node(&gripper("save", &file, &[]));
    let count = values(&file).len();
    assert_eq!(saved, format!("{file}: {count} values of node 4 on can1\n"));
    let text = std::fs::read_to_string(&file).unwrap();
    for line in ["NodeID=4", "NodeName=gripper", "Baudrate=500", "LastEDS=gripper.eds"] {
        assert!(text.lines().any(|shown| shown == line), "{line}: {text}");
    }
    let same = served.node(&gripper("diff", &file, &[]));
    assert_eq!(same, format!("{file} and node 4 on can1: {count} values compared, 0 different\n"));

    write("grip force", "33");
    write("label", "right");
    let via = ["--via", served.path.as_str(), "node"];
    let different = ends(1, &[&via[..], &gripper("diff", &file, &[])].concat());
    let lines: Vec<_> = different.lines().collect();
    assert_eq!(
        lines[..3],
        [
            "OBJECT     NAME        FILE        NODE",
            "0x2000:00  Grip force  120 (0x78)  33 (0x21)",
            "0x2002:00  Label       \"left\"      \"right\"",
        ]
    );
    let json = json_of(&ends(1, &[&["--json"], &via[..], &gripper("diff", &file, &[])].concat()));
    assert_eq!(json["differences"][0]["name"], "Grip force");
    assert_eq!(
        (&json["differences"][0]["file"], &json["differences"][0]["node"]),
        (&120.into(), &33.into())
    );

    let message = served.node_fails(2, &gripper("restore", &file, &[]));
    assert!(message.contains("cannot ask for confirmation of writing"), "{message}");
    let restored = served.node(&gripper("restore", &file, &["--yes"]));
    assert!(restored.starts_with(&format!("{file} to node 4 on can1: ")), "{restored}");
    // Of a PDO only as many mapped objects are written as it has.
    assert!(restored.ends_with(": 26 writes, 19 values verified\n"), "{restored}");
    assert_eq!(served.node(&gripper("diff", &file, &[])), same);
    assert_eq!(
        served.node(&["sdo", "read", "--node", "1.4", "--eds", &eds, "label"]),
        "0x2002:00 Label = \"left\"\n"
    );
    // A DCF is a device file, too.
    assert!(served.node(&["info", "1.4", "--eds", &file]).contains("identity matches"));
    served.end();
}

#[test]
fn moving_drive_is_not_restored() {
    let served = machine();
    let eds = format!("{EXAMPLE}/servo_drive.eds");
    let file = served.path_of("shoulder.dcf");
    served.node(&["params", "save", &file, "--node", "1", "--eds", &eds]);
    let objects = std::fs::read_to_string(&file).unwrap();
    let controlword = objects.split("[6040]").nth(1).unwrap().split('[').next().unwrap();
    assert!(!controlword.contains("ParameterValue"), "a command: {controlword}");
    for (object, value) in [("0x6060", "1"), ("0x6040", "6"), ("0x6040", "7"), ("0x6040", "15")] {
        served.node(&["sdo", "write", "--node", "1", "--yes", object, value]);
    }
    let restore = ["params", "restore", &file, "--node", "1", "--yes"];
    let message = served.node_fails(5, &restore);
    let expected = "node 1 on can0 is a drive in the state \"operation enabled\" (0x6041:00 = 0x";
    assert!(message.contains(expected), "{message}");
    served.node(&["sdo", "write", "--node", "1", "--yes", "0x6040", "0"]);
    assert!(served.node(&restore).contains(" values verified\n"));
    served.end();
}

#[test]
fn unsuitable_files_are_rejected() {
    let served = machine();
    let eds = format!("{EXAMPLE}/gripper.eds");
    let file = served.path_of("gripper.dcf");
    let save = ["params", "save", &file, "--node", "1.4"];
    assert_has(&served.node_fails(2, &save), "use its device file: --eds FILE");
    let of_drive =
        ["--eds", concat!(env!("CARGO_MANIFEST_DIR"), "/../../examples/network/servo_drive.eds")];
    let message = served.node_fails(5, &[&save[..], &of_drive].concat());
    assert!(message.contains("node 4 on can1 has vendor-ID 0x00000ABC, and"), "{message}");
    assert!(!std::path::Path::new(&file).exists(), "no file without values");
    served.node(&[&save[..], &["--eds", &eds]].concat());
    let message = served.node_fails(6, &[&save[..], &["--eds", &eds]].concat());
    assert!(message.contains("file exists; use --force"), "{message}");
    served.node(&[&save[..], &["--eds", &eds, "--force"]].concat());

    let message = served.node_fails(6, &["params", "diff", &eds, "--node", "1.4"]);
    assert!(message.contains("an EDS has no values of a node"), "{message}");
    let other = ["params", "restore", &file, "--node", "1.5", "--yes"];
    assert_has(&served.node_fails(2, &other), "is of node 4, with its COB-IDs; for node 5 on can1");
    let message = served.node_fails(5, &[&other[..], &["--application"]].concat());
    assert!(message.contains("from node 5 (slave 0, channel 1): no answer"), "{message}");
    served.end();
}

#[test]
fn values_that_the_node_rejects_are_listed() {
    let served = machine();
    let eds = format!("{EXAMPLE}/gripper.eds");
    let file = served.path_of("gripper.dcf");
    served.node(&["params", "save", &file, "--node", "1.4", "--eds", &eds]);
    let text = std::fs::read_to_string(&file).unwrap();
    let text = text.replace("[2000]", "[2100]\nParameterName=Newer object\nObjectType=7\nDataType=5\nAccessType=rw\nParameterValue=3\n\n[2000]");
    std::fs::write(&file, text).unwrap();
    let via = ["--via", served.path.as_str(), "node"];
    let restore = ["params", "restore", &file, "--node", "1.4", "--yes", "--application"];
    let report = ends(5, &[&via[..], &restore].concat());
    assert!(
        report.contains("0x2100:00  Newer object  3     aborted by the node: 0x06020000"),
        "{report}"
    );
    assert!(report.contains("0x2100:00") && !report.contains("0x2000:00"), "{report}");
    assert_has(&served.node_fails(5, &restore), "1 values of node 4 on can1 were not restored");
    let diff = ends(1, &[&via[..], &["params", "diff", &file, "--node", "1.4"]].concat());
    assert!(diff.contains("0x2100:00  Newer object  3     aborted by the node"), "{diff}");
    // The node has no 0x1010.
    std::fs::remove_file(&file).unwrap();
    served.node(&["params", "save", &file, "--node", "1.4", "--eds", &eds]);
    let message = served.node_fails(5, &[&restore[..], &["--store"]].concat());
    assert!(message.contains("the values are active until a reset, not stored: SDO"), "{message}");
    served.end();
}

#[test]
fn stored_values_outlive_a_reset() {
    let scenario = Scenario::new(
        "[[node]]\nkind = \"drive\"\nname = \"x\"\nbus = \"0.0\"\nnode_id = 5\neds = \"x.eds\"\n",
    );
    let object =
        |index: &str, name: &str, rest: &str| format!("[{index}]\nParameterName={name}\n{rest}\n");
    let value = "ObjectType=7\nDataType=6\nAccessType=rw\nDefaultValue=1";
    let eds = object("1000", "Device type", "DataType=7\nAccessType=ro\nDefaultValue=0x191")
        + &object("1010", "Store", "ObjectType=8\nSubNumber=2")
        + &object("1010sub0", "Count", "DataType=5\nAccessType=ro\nDefaultValue=1")
        + &object("1010sub1", "All", "DataType=7\nAccessType=rw\nDefaultValue=1")
        + &object("2000", "Gain", value);
    let eds = scenario.write("x.eds", &eds);
    let mut served = serve_bus(&scenario.setting(), &[]);
    served.program.wait_for_error("slave 0: ready");
    let gain = ["--node", "5", "--eds", &eds, "gain"];
    served.node(&[&["sdo", "write"], &gain[..], &["77"]].concat());
    let file = served.path_of("x.dcf");
    served.node(&["params", "save", &file, "--node", "5", "--eds", &eds]);
    served.node(&["nmt", "reset", "--node", "5", "--yes"]);
    assert_eq!(served.node(&[&["sdo", "read"], &gain[..]].concat()), "0x2000:00 Gain = 1\n");
    let restored = served.node(&["params", "restore", &file, "--node", "5", "--yes", "--store"]);
    assert!(restored.ends_with("1 writes, 1 values verified, stored\n"), "{restored}");
    served.node(&["nmt", "reset", "--node", "5", "--yes"]);
    assert_eq!(
        served.node(&[&["sdo", "read"], &gain[..]].concat()),
        "0x2000:00 Gain = 77 (0x4D)\n"
    );
    served.end();
}
