//! Reading of the CANopen nodes of a file, and the locations of their faults.

use std::time::Duration;

use ecan_canopen::{
    BootConfig, BootReset, ConfigurationDate, GuardingConfig, HostHeartbeat, IdentityCheck,
    NetworkConfig, NodeId, OperatingMode, PdoDirection, PdoMapping, RevisionCheck,
    TransmissionType,
};
use ecan_cia402::{AxisConfig, DriveConfig, NodeReset, Takeover};
use ecan_lite::config::{
    NetworkSettings, load_axes, load_network, load_network_settings, load_nodes,
};

use super::network_files::{
    GATEWAY, GRIPPER, SERVO, address, directory, faults, faults_with, has, id, nodes,
};

const FULL: &str = r#"[[node]]
name = "left gripper"
gateway = 0
channel = 1
node = 9
device_file = "gripper.eds"
mandatory = false
order = 2
reset = "node"
boot_timeout_ms = 800
revision = "compatible"
serial_number = 77
software = 0x1234
restore = "communication"
configuration_date = 2026-11-24T09:30:00
save = true
heartbeat_ms = 50
start = false
reboot = false
[node.parameters]
"Grip force" = 120
"0x2002" = "left"
"0x1014:0" = "0x90"
[[node.rpdo]]
number = 1
transmission = 1
objects = ["grip force"]
[[node.tpdo]]
number = 2
cob_id = 0x3A9
transmission = 254
inhibit_time_100us = 20
event_timer_ms = 100
objects = ["Jaw position", "0x2003"]
[[node.tpdo]]
number = 1
enabled = false
"#;

/// The gripper with the objects of [`FULL`] that it does not have.
fn gripper_with_memory() -> String {
    let number = |section: &str, bits: u8| {
        let data_type = if bits == 16 { 6 } else { 7 };
        format!("[{section}]\nParameterName={section}\nDataType={data_type}\nAccessType=rw\n")
    };
    let mut text = GRIPPER.to_owned() + &number("1801sub3", 16) + &number("1801sub5", 16);
    for (index, last) in [("1010", 1), ("1011", 2), ("1020", 2), ("1F56", 1)] {
        text +=
            &format!("[{index}]\nParameterName={index}\nObjectType=8\nSubNumber={}\n", last + 1);
        text += &format!(
            "[{index}sub0]\nParameterName=n\nDataType=5\nAccessType=ro\nDefaultValue={last}\n"
        );
        text.extend((1..=last).map(|nth| number(&format!("{index}sub{nth}"), 32)));
    }
    text
}

#[test]
fn node_has_every_value_of_its_table() {
    let device = gripper_with_memory();
    let directory =
        directory(&[("cell.toml", &format!("{GATEWAY}{FULL}")), ("gripper.eds", &device)]);
    let node = load_nodes(directory.path().join("cell.toml"))
        .unwrap_or_else(|error| panic!("{error}"))
        .remove(0);
    assert_eq!((node.name.as_str(), node.address), ("left gripper", address(1, 9)));
    let parameters = node.boot.parameters.clone();
    let boot = BootConfig {
        name: "left gripper".into(),
        is_mandatory: false,
        order: 2,
        reset: BootReset::Node,
        boot_timeout: Duration::from_millis(800),
        identity: IdentityCheck {
            device_type: Some(0x191),
            vendor_id: Some(0xABC),
            product_code: Some(0x42),
            revision: RevisionCheck::Compatible(0x0001_0002),
            serial_number: Some(77),
        },
        software: Some(0x1234),
        restores: Some(2),
        parameters: parameters.clone(),
        heartbeat_ms: 50,
        starts: false,
        reboots: false,
        ..BootConfig::default()
    };
    assert_eq!(node.boot, boot);
    let date = ConfigurationDate { days: 15_668, milliseconds: 34_200_000 };
    assert_eq!((parameters.date, parameters.saves), (Some(date), true));
    let values: Vec<_> = node
        .parameters()
        .unwrap()
        .into_iter()
        .map(|parameter| (parameter.index, parameter.data, parameter.name.to_string()))
        .collect();
    let expected = [
        (0x1014, vec![0x90, 0, 0, 0], "COB-ID EMCY"),
        (0x2000, vec![120, 0], "Grip force"),
        (0x2002, b"left".to_vec(), "Label"),
    ];
    let mut sorted = values.clone();
    sorted.sort();
    assert_eq!(sorted, expected.map(|(index, data, name)| (index, data, name.to_owned())));
    let [rpdo, tpdo] = &node.pdos[..] else { panic!("{:?}", node.pdos) };
    let bits = |pdo: &PdoMapping| pdo.entries.iter().map(|entry| entry.raw()).collect::<Vec<_>>();
    assert_eq!((rpdo.cob_id, rpdo.transmission), (id(0x209), TransmissionType::Synchronous(1)));
    assert_eq!(bits(rpdo), [0x2000_0010]);
    assert_eq!((tpdo.cob_id, tpdo.transmission), (id(0x3A9), TransmissionType::EventManufacturer));
    assert_eq!((tpdo.inhibit_time, tpdo.event_timer_ms), (Some(20), Some(100)));
    assert_eq!(bits(tpdo), [0x2001_0020, 0x2003_0020]);
    assert_eq!(node.disabled_pdos, [(PdoDirection::Transmit, 1)]);
    assert!(node.boot_config().unwrap().steps.len() > 10);
}

#[test]
fn node_without_keys_has_the_values_of_its_device_file() {
    let node = nodes("[[node]]\ngateway = 0\nchannel = 0\nnode = 3\ndevice_file = \"gripper.eds\"");
    let boot = &node[0].boot;
    assert_eq!((boot.is_mandatory, boot.starts, boot.heartbeat_ms), (true, true, 100));
    assert_eq!(boot.identity.vendor_id, Some(0xABC));
    assert_eq!(boot.identity.revision, RevisionCheck::Any, "makers change it");
    assert!(node[0].parameters().unwrap().is_empty(), "defaults of an EDS are not written");
    let any = nodes("[[node]]\ngateway = 0\nchannel = 0\nnode = 3\ncheck_identity = false");
    assert_eq!(any[0].boot.identity, IdentityCheck::default());
}

#[test]
fn values_of_a_dcf_are_written_and_overridden() {
    let dcf = GRIPPER
        .replace("[2000]\n", "[2000]\nParameterValue=200\n")
        .replace("[2002]\n", "[2002]\nParameterValue=from the file\n")
        .replace("[1401sub1]\n", "[1401sub1]\nParameterValue=0x301\n")
        + "[DeviceComissioning]\nNodeID=21\nNodeName=gripper\nBaudrate=1000\n";
    let text = "[[node]]\ngateway = 0\nchannel = 0\ndevice_file = \"g.dcf\"\n\
                parameters = { Label = \"here\" }\n[[node.rpdo]]\nnumber = 2\nobjects = [\"Grip force\"]";
    let files = [("g.dcf", dcf.as_str()), ("cell.toml", &format!("{GATEWAY}{text}"))];
    let directory = directory(&files);
    let nodes = load_nodes(directory.path().join("cell.toml")).unwrap_or_else(|e| panic!("{e}"));
    assert_eq!(nodes[0].address, address(0, 21), "the node-ID of the DCF");
    let values: Vec<_> = nodes[0]
        .parameters()
        .unwrap()
        .into_iter()
        .map(|parameter| (parameter.index, parameter.data))
        .collect();
    assert_eq!(values, [(0x2000, vec![200, 0]), (0x2002, b"here".to_vec())]);
    assert_eq!(nodes[0].pdos[0].cob_id, id(0x301), "the COB-ID of the DCF");
}

#[test]
fn axes_of_nodes_are_in_the_axis_table() {
    let text = "[[axis]]\ngateway = 0\nchannel = 0\nnode = 1\n\
                [[node]]\ngateway = 0\nchannel = 1\nnode = 2\naxis = { step_limit = 77 }";
    let directory = directory(&[("cell.toml", &format!("{GATEWAY}{text}"))]);
    let axes = load_axes(directory.path().join("cell.toml")).unwrap_or_else(|e| panic!("{e}"));
    let mut second = AxisConfig::new(address(1, 2)).with_step_limit(77);
    second.drive.reset = NodeReset::Communication;
    assert_eq!(axes, [AxisConfig::new(address(0, 1)), second]);
}

/// A node with two axes and a PDO of its own.
const SHARED: &str = r#"[[node]]
gateway = 0
channel = 1
node = 2
name = "gantry"
heartbeat_ms = 70
[[node.tpdo]]
number = 4
cob_id = 0x333
transmission = 255
objects = ["0x603F"]
[[node.axis]]
mode = "csv"
[[node.axis]]
pdo_number = 2
step_limit = 88
"#;

/// The device file of the servo drive with a second axis: its objects are 0x800 further.
fn two_axes() -> String {
    let first = SERVO.find("[6007]").unwrap();
    let shifted = SERVO[first..].lines().map(|line| {
        let index = line.strip_prefix("[6").and_then(|rest| rest.get(..3));
        match index.and_then(|digits| u16::from_str_radix(digits, 16).ok()) {
            Some(index) => format!("[{:X}{}\n", 0x6800 + index, &line[5..]),
            None => format!("{line}\n"),
        }
    });
    SERVO.to_owned() + &shifted.collect::<String>()
}

#[test]
fn axes_of_a_node_share_its_settings() {
    let shared =
        SHARED.replace("heartbeat_ms = 70", "heartbeat_ms = 70\ndevice_file = \"servo.eds\"");
    let servo = two_axes();
    let files = [("cell.toml", &*format!("{GATEWAY}{shared}")), ("servo.eds", &servo)];
    let directory = directory(&files);
    let path = directory.path().join("cell.toml");
    let axes = load_axes(&path).unwrap_or_else(|error| panic!("{error}"));
    let [first, second] = &axes[..] else { panic!("{axes:?}") };
    assert_eq!((first.node_axis, first.pdos.number), (0, 1));
    assert_eq!((first.mode, first.drive.heartbeat_ms), (OperatingMode::CyclicVelocity, 70));
    assert!(!first.drive.further.is_empty(), "the PDO of the node is mapped once");
    let mut expected = AxisConfig::new(address(1, 2)).with_node_axis(1, 2).with_step_limit(88);
    expected.drive = DriveConfig { further: Vec::new(), ..first.drive.clone() };
    assert_eq!(*second, expected);

    let network = load_network(&path).unwrap();
    let [gantry] = &network.nodes[..] else { panic!("{network:?}") };
    let pdos: Vec<_> = gantry.pdos.iter().map(|pdo| (pdo.number, pdo.entries[0].index)).collect();
    assert_eq!(pdos, [(4, 0x603F), (1, 0x6040), (1, 0x6041), (2, 0x6840), (2, 0x6841)]);
    assert!(load_nodes(&path).unwrap().is_empty(), "the axis table configures it");
}

#[test]
fn faults_of_axes_of_a_node_are_reported_at_their_keys() {
    let shared = SHARED.replace("objects = [\"0x603F\"]\n", "enabled = false\n");
    let found = |text: &str| faults(text);
    let one = |change: &str, line: usize, part: &str| {
        let found = found(&shared.replace("pdo_number = 2", change));
        assert!(
            found.len() == 1 && found[0].0 == line && found[0].1.contains(part),
            "line {line}: {part}: {found:#?}"
        );
    };
    // Each is reported once, though the check of the network finds some of them, too.
    one("pdo_number = 1", 15, "axis 1: COB-ID 0x202 is that of a PDO of axis 0 already");
    let ids = "rpdo_cob_ids = [0x301]\ntpdo_cob_ids = [0x282]\n";
    one(&format!("{ids}pdo_number = 1"), 17, "axis 1: PDO 1 is one of axis 0 of the same node");
    one(&format!("{}pdo_number = 65", ids.replace("0x282", "0x182")), 16, "COB-ID 0x182 is that");
    one(
        "pdo_number = 2\nnode_axis = 0",
        16,
        "is the drive of axis 0 already; set another node_axis",
    );
    one("pdo_number = 2\nhost_heartbeat_ms = 9", 14, "the settings of node 2");
    one("pdo_number = 2\nramp = -1", 16, "`ramp` = -1 is out of range");
    // The node's own PDO, and objects that the device does not have.
    let own = shared.replace("number = 4", "number = 2").replace("enabled = false", "");
    assert!(found(&own).iter().any(|fault| fault.1.contains("TPDO 2 is described twice")), "{own}");
    let text = shared.replace("heartbeat_ms = 70", "device_file = \"servo.eds\"");
    let single = faults_with(&text, &[("servo.eds", SERVO)]);
    assert!(single.iter().all(|fault| fault.0 == 4), "{single:#?}");
    assert!(single[0].1.contains("the device file has no object 0x6840:00"), "{single:#?}");
}

#[test]
fn faults_of_a_node_are_reported_together_with_their_lines() {
    let text = r#"[[node]]
gateway = 0
channel = 1
node = 9
device_file = "gripper.eds"
heartbeat = 5
[node.parameters]
"Grip forse" = 120
"0x2000" = 9
"Jaw position" = 1
"0x2002" = 0x41
"0x2003" = "warm"
[[node.rpdo]]
number = 1
objects = ["Grip force", "Jaw position"]
[[node.rpdo]]
number = 3
cob_id = 0x77F
objects = ["0x2000"]
[[node.tpdo]]
number = 1
objects = ["Jaw position", "Temperature", "0x1001", "Label"]
"#;
    let expected = [
        (6, "unknown key `heartbeat`"),
        (8, "Grip forse"),
        (9, "node 9: 0x2000:00 (Grip force) = 9 is out of range; allowed: 10 to 400"),
        (10, "node 9: 0x2001:00 (Jaw position) cannot be written"),
        (12, "`0x2003`: `warm` is not a number"),
        (13, "node 9: RPDO 1: 0x2001:00 (Jaw position) cannot be mapped"),
        (16, "node 9: RPDO 3: COB-ID 0x77F is reserved"),
        (16, "node 9: RPDO 3: the device file has no object 0x1402"),
        (20, "node 9: TPDO 1: 72 bits in 3 entries are mapped; allowed: 1 to 64 bits"),
        (22, "`Label` is VISIBLE_STRING; a PDO cannot contain it"),
    ];
    let found = faults(text);
    assert_eq!(found.len(), expected.len(), "{found:#?}");
    for ((line, reason), (expected_line, part)) in found.iter().zip(expected) {
        assert!(*line == expected_line && reason.contains(part), "{line} {reason}: {part}");
    }
}

#[test]
fn collisions_over_the_bus_are_found() {
    let node = |channel: u8, node: u8, more: &str| {
        format!(
            "[[node]]\ngateway = 0\nchannel = {channel}\nnode = {node}\ndevice_file = \"gripper.eds\"\n{more}"
        )
    };
    let tpdo = "[[node.tpdo]]\nnumber = 2\ncob_id = 0x183\nobjects = [\"Jaw position\"]\n";
    // TPDO 1 of node 3 exists by its device file.
    let text = node(0, 3, "") + &node(0, 4, tpdo) + &node(1, 5, tpdo) + &node(0, 3, "");
    let found = faults(&text);
    let texts: Vec<_> = found.iter().map(|(_, reason)| reason.as_str()).collect();
    assert!(texts.contains(&"COB-ID 0x183 is sent by TPDO 1 of node 3 and by TPDO 2 of node 4; each may have one sender"), "{texts:#?}");
    has(&found, "node 3 (slave 0, channel 0) is described twice");
    assert!(!texts.iter().any(|text| text.contains("node 5")), "{texts:#?}");
    let emcy = node(0, 3, "parameters = { \"0x1014\" = 0x84 }\n") + &node(0, 4, "");
    let text = &faults(&emcy)[0].1;
    assert_eq!(
        text,
        "COB-ID 0x084 is sent by EMCY of node 3 and by EMCY of node 4; each may have one sender"
    );
}

#[test]
fn bus_load_and_bit_rate_are_checked() {
    let mut text = String::new();
    for node in 1..=12 {
        text += &format!(
            "[[node]]\ngateway = 0\nchannel = 1\nnode = {node}\ndevice_file = \"gripper.eds\"\n\
             [[node.tpdo]]\nnumber = 1\ntransmission = 1\nobjects = [\"Jaw position\", \"Temperature\"]\n"
        );
    }
    let found = faults(&text);
    assert_eq!(found.len(), 1, "{found:#?}");
    assert!(found[0].1.starts_with("slave 0 channel 1: the network needs"), "{found:#?}");
    let slow = "[[node]]\ngateway = 0\nchannel = 2\nnode = 1\ndevice_file = \"gripper.eds\"\n\
                [[gateway]]\nn = 3\ncan0 = { bitrate = 250_000 }\n\
                [[node]]\ngateway = 1\nchannel = 0\nnode = 1\ndevice_file = \"gripper.eds\"\n";
    let texts: Vec<_> = faults(slow).into_iter().map(|(_, reason)| reason).collect();
    assert!(
        texts[0].contains("node 1 (slave 0, channel 2): the channel is not enabled"),
        "{texts:?}"
    );
    assert!(texts[1].contains("the device does not support 250 kbit/s"), "{texts:?}");
}

#[test]
fn absent_and_invalid_device_files_are_reported_once() {
    let node = |node: u8, file: &str| {
        format!(
            "[[node]]\ngateway = 0\nchannel = 0\nnode = {node}\ndevice_file = \"{file}\"\nparameters = {{ \"Grip force\" = 20 }}\n"
        )
    };
    let text = node(1, "absent.eds") + &node(2, "broken.eds");
    let found = faults_with(&text, &[("broken.eds", "[1000\nthis is not a device file")]);
    assert_eq!(found.len(), 2, "{found:#?}");
    assert!(found[0].1.contains("cannot read absent.eds") && found[0].0 == 5, "{found:#?}");
    assert!(found[1].1.contains("broken.eds") && found[1].0 == 11, "{found:#?}");
}

#[test]
fn network_has_its_settings() {
    let settings = |network: &str, bus: &str| {
        let bus = format!("{bus}[[bus]]\ngateway = 0\nchannel = 0\nfile = \"bus.yml\"\n");
        let text = format!("{GATEWAY}[network]\n{network}\n{bus}");
        let empty = "master:\n  node_id: 3\n  sync_period: 4000\nnodes: {}\n";
        let directory = directory(&[("cell.toml", &text), ("bus.yml", empty)]);
        load_network_settings(directory.path().join("cell.toml"))
    };
    let all = settings(
        "sync_cycles = 3\nsync_counter = 0\ntarget_cycles = 6\ntakeover = \"adopt\"\ntime_ms = 200\n\
         host_node = 9\nhost_heartbeat_ms = 30\nservice_frames_per_cycle = 3\nsdo_pending_limit = 2\n\
         reserved_image_bytes = 64\nnmt_queue = 5\nsdo_timeout_ms = 7\nsdo_storage_timeout_ms = 8\n\
         sdo_retries = 0\nsdo_buffer_bytes = 99",
        "",
    )
    .unwrap();
    let mut expected = NetworkSettings::default();
    let config = &mut expected.cia402;
    (config.sync.every_cycles, config.motion_div, config.takeover) = (3, 6, Takeover::Adopt);
    let host = HostHeartbeat { node: NodeId::new(9).unwrap(), period: Duration::from_millis(30) };
    config.network = NetworkConfig {
        service_frames_per_cycle: 3,
        sdo_pending_limit: 2,
        reserved_image_bytes: 64,
        nmt_queue: 5,
        host_heartbeat: Some(host),
    };
    let sdo = &mut config.node.sdo;
    (sdo.timeout, sdo.storage_timeout) = (Duration::from_millis(7), Duration::from_millis(8));
    (sdo.retries, sdo.buffer_bytes) = (0, 99);
    expected.time_period = Some(Duration::from_millis(200));
    assert_eq!(all, expected, "the table has precedence over the bus");

    let by_bus = settings("", "").unwrap().cia402;
    assert_eq!(by_bus.sync.every_cycles, 2);
    assert_eq!(by_bus.network.host_heartbeat.unwrap().node, NodeId::new(3).unwrap());
    assert_eq!(settings("host_heartbeat_ms = 0", "").unwrap().cia402.network.host_heartbeat, None);
    let faults = settings("sync_counter = 1\nhost_node = 0", "").unwrap_err().to_string();
    assert!(faults.contains("`sync_counter` = 1 is out of range; allowed: 0 for none"), "{faults}");
    assert!(faults.contains("`host_node` = 0 is out of range; allowed: 1 to 127"), "{faults}");
    // The node-ID of the host is taken.
    let node = "[[node]]\ngateway = 0\nchannel = 1\nnode = 9\n";
    let faults = settings("host_node = 9", node).unwrap_err().to_string();
    assert!(faults.contains("heartbeat"), "{faults}");
}

#[test]
fn guarding_of_a_node_is_that_of_its_axis() {
    let text = format!(
        "{GATEWAY}[[node]]\ngateway = 0\nchannel = 0\nnode = 3\nheartbeat_ms = 0\n\
         guard_time_ms = 70\n[node.axis]\nmode = \"csp\"\n"
    );
    let directory = directory(&[("cell.toml", &text)]);
    let axes = load_axes(directory.path().join("cell.toml")).unwrap_or_else(|e| panic!("{e}"));
    let guarding = GuardingConfig { guard_time: Duration::from_millis(70), life_time_factor: 3 };
    assert_eq!(axes[0].drive.guarding, Some(guarding));
}

#[test]
fn example_has_the_defaults() {
    let directory = directory(&[("cell.toml", ecan_lite::config::EXAMPLE)]);
    let node = load_nodes(directory.path().join("cell.toml")).unwrap().remove(0);
    assert_eq!(node.boot, BootConfig { name: "gripper".into(), ..BootConfig::default() });
}
