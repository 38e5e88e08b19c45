//! Reading of a network in the form of ros2_canopen, and the locations of its faults.

use std::time::Duration;

use ecan_canopen::{
    HostHeartbeat, NodeDescription, NodeId, OperatingMode, PdoDirection, RevisionCheck,
    TransmissionType,
};
use ecan_cia402::{InputObject, OutputObject, Scale};
use ecan_lite::config::{load_axes, load_network, load_network_settings, load_nodes, load_notes};

use super::network_files::{GATEWAY, GRIPPER, SERVO, address, directory, faults_with, has, id};

/// A file in the form of ros2_canopen.
const BUS: &str = r#"
options:
  dcf_path: "@BUS_CONFIG_PATH@"

master:
  node_id: 1
  driver: "ros2_canopen::MasterDriver"
  package: "canopen_master_driver"
  sync_period: 10000

defaults:
  dcf: "gripper.eds"
  driver: "ros2_canopen::ProxyDriver"
  package: "canopen_proxy_driver"
  period: 10
  revision_number: 0
  sdo:
    - {index: 0x2000, sub_index: 0, value: 60}
  tpdo:
    1:
      enabled: true
      cob_id: "auto"
      transmission: 0x01
      mapping:
        - {index: 0x2001, sub_index: 0} # jaw position
        - {index: 0x2003}
    2:
      enabled: false

nodes:
  gripper_1:
    node_id: 2
  gripper_2:
    node_id: 3
    mandatory: true
    serial_number: 5
    heartbeat_producer: 200
    sdo: []
"#;

#[test]
fn bus_of_ros2_canopen_is_read_as_it_is() {
    let text = "[[bus]]\ngateway = 0\nchannel = 0\nfile = \"config/arm/bus.yml\"\n";
    let files = [
        ("config/arm/bus.yml", BUS),
        ("config/arm/gripper.eds", GRIPPER),
        ("cell.toml", &format!("{GATEWAY}{text}")),
    ];
    let directory = directory(&files);
    let nodes = load_nodes(directory.path().join("cell.toml")).unwrap_or_else(|e| panic!("{e}"));
    let [first, second] = &nodes[..] else { panic!("{nodes:?}") };
    assert_eq!((first.name.as_str(), first.address), ("gripper_1", address(0, 2)));
    assert_eq!((second.name.as_str(), second.address), ("gripper_2", address(0, 3)));
    assert_eq!((first.boot.is_mandatory, second.boot.is_mandatory), (false, true));
    assert_eq!((first.boot.heartbeat_ms, second.boot.heartbeat_ms), (0, 200));
    assert_eq!(first.boot.identity.revision, RevisionCheck::Any);
    assert_eq!(second.boot.identity.serial_number, Some(5));
    let values = |node: &NodeDescription| {
        node.overrides.iter().map(|entry| (entry.index, entry.data.clone())).collect::<Vec<_>>()
    };
    assert_eq!((values(first), values(second)), (vec![(0x2000, vec![60, 0])], vec![]));
    for node in &nodes {
        let [tpdo] = &node.pdos[..] else { panic!("{:?}", node.pdos) };
        assert_eq!(tpdo.cob_id, id(0x180 + u16::from(node.address.node.get())));
        assert_eq!(tpdo.transmission, TransmissionType::Synchronous(1));
        assert_eq!(tpdo.entries.len(), 2);
        assert_eq!(node.disabled_pdos, [(PdoDirection::Transmit, 2)]);
    }
}

#[test]
fn merge_keys_take_over_and_other_keys_are_noted() {
    let bus = r#"
common: &common
  dcf: "gripper.eds"
  driver: "ros2_canopen::ProxyDriver"
  node_id: 99
slow: &slow { boot_timeout_ms: 900, polling: true }
nodes:
  left: { <<: *common, node_id: 5 }
  right: { node_id: 6, serial_numbr: 7, <<: [*common, *slow] }
"#;
    let bus = bus.replace("common: &", ".common: &").replace("slow: &", ".slow: &");
    let text = format!("{GATEWAY}[[bus]]\ngateway = 0\nchannel = 0\nfile = \"bus.yml\"\n");
    let directory = directory(&[("cell.toml", text.as_str()), ("bus.yml", &bus)]);
    let path = directory.path().join("cell.toml");
    let nodes = load_nodes(&path).unwrap_or_else(|error| panic!("{error}"));
    let read = |nth: usize| {
        let NodeDescription { address, device, boot, .. } = &nodes[nth];
        (*address, device.is_some(), boot.boot_timeout.as_millis())
    };
    assert_eq!(read(0), (address(0, 5), true, 5_000));
    assert_eq!(read(1), (address(0, 6), true, 900));
    assert_eq!(
        load_notes(&path).unwrap(),
        ["right: ignored in its bus.yml: `serial_numbr`, `polling`"]
    );
}

#[test]
fn faults_of_a_bus_have_its_lines() {
    let bus = BUS
        .replace("value: 60", "value: 500")
        .replace("mandatory: true", "mandatory: maybe")
        .replace("index: 0x2003", "index: 0x2009");
    let text = "[[bus]]\ngateway = 0\nchannel = 0\nfile = \"bus.yml\"\n";
    let found = faults_with(text, &[("bus.yml", &bus)]);
    let texts: Vec<_> = found.iter().map(|(_, reason)| reason.as_str()).collect();
    let part = "`file` bus.yml: line 35, column 16: `mandatory` must be true or false";
    assert!(texts.contains(&part), "{part}: {texts:#?}");
    let bus = bus.replace("maybe", "true");
    let found = faults_with(text, &[("bus.yml", &bus)]);
    let is_there = |text: &String| text.contains("line 26") && text.contains("0x2009");
    assert!(found.iter().any(|(_, reason)| is_there(reason)), "{found:#?}");
    has(&found, "(Grip force) = 500 is out of range");
    let broken = faults_with(text, &[("bus.yml", "a: [1\nb: 2")]);
    assert!(broken[0].1.starts_with("`file` bus.yml: line "), "{broken:#?}");
}

/// A bus of drives as ros2_canopen has it.
const DRIVES: &str = r#"
master:
  node_id: 1
  driver: "ros2_canopen::MasterDriver"
  package: "canopen_master_driver"
  sync_period: 10000
  sync_overflow: 20
  heartbeat_producer: 40
  heartbeat_multiplier: 2.5

defaults:
  dcf: "servo_drive.eds"
  driver: "ros2_canopen::Cia402Driver"
  package: "canopen_402_driver"
  period: 10
  revision_number: 0
  position_mode: 1
  scale_pos_to_dev: 2000.0
  scale_vel_to_dev: 500
  offset_pos_to_dev: 12.0
  heartbeat_consumer: true
  tpdo:
    1:
      enabled: true
      cob_id: "auto"
      transmission: 0x01
      mapping:
        - {index: 0x6041, sub_index: 0}
        - {index: 0x6061, sub_index: 0}
    2:
      enabled: true
      cob_id: "auto"
      transmission: 0x01
      mapping:
        - {index: 0x6064, sub_index: 0}
        - {index: 0x606C, sub_index: 0}
    3:
      enabled: false
  rpdo:
    1:
      enabled: true
      cob_id: "auto"
      mapping:
        - {index: 0x6040, sub_index: 0}
        - {index: 0x6060, sub_index: 0}
    2:
      enabled: true
      cob_id: "auto"
      mapping:
        - {index: 0x607A, sub_index: 0}

nodes:
  joint_1:
    node_id: 2
    serial_number: 5
  joint_2:
    node_id: 3
    position_mode: 8
    heartbeat_consumer: false
    driver: "ros2_canopen::LifecycleCia402Driver"
  gripper:
    node_id: 4
    dcf: "gripper.eds"
    driver: "ros2_canopen::ProxyDriver"
    error_behavior: {1: 2}
    tpdo: {}
    rpdo: {}
"#;
#[test]
fn drives_of_ros2_canopen_are_axes() {
    let bus = "[[bus]]\ngateway = 0\nchannel = 0\nfile = \"bus.yml\"\n";
    let text = format!("{GATEWAY}{bus}");
    let gripper = GRIPPER.replace("[1017]", EXTRA);
    let files = [
        ("cell.toml", &*text),
        ("bus.yml", DRIVES),
        ("servo_drive.eds", SERVO),
        ("gripper.eds", &gripper),
    ];
    let directory = directory(&files);
    let path = directory.path().join("cell.toml");
    let axes = load_axes(&path).unwrap_or_else(|error| panic!("{error}"));
    let [first, second] = &axes[..] else { panic!("{axes:?}") };
    assert_eq!((first.address, second.address), (address(0, 2), address(0, 3)));
    assert_eq!(first.mode, OperatingMode::ProfilePosition);
    assert_eq!(second.mode, OperatingMode::CyclicPosition);
    assert_eq!(first.pdos.inputs, [InputObject::ModeDisplay, InputObject::Velocity]);
    assert_eq!(first.pdos.outputs, [OutputObject::Mode]);
    let turn = std::f64::consts::TAU;
    let scale = Scale::steps_per_turn(2000.0 * turn).with_origin(12);
    assert_eq!(first.scale, scale.with_velocity_units(500.0 * turn));
    assert_eq!(first.drive.identity.serial_number, Some(5));
    // 2.5 heartbeats of 40 ms.
    assert_eq!((first.drive.host_heartbeat_ms, second.drive.host_heartbeat_ms), (100, 0));
    assert!(first.drive.further.is_empty(), "the axis maps the PDOs");

    let settings = load_network_settings(&path).unwrap();
    let sync = settings.cia402.sync;
    assert_eq!((sync.every_cycles, sync.counter_overflow), (5, Some(20)), "cycles of 2 ms");
    let host = HostHeartbeat { node: NodeId::MIN, period: Duration::from_millis(40) };
    assert_eq!(settings.cia402.network.host_heartbeat, Some(host));

    let nodes = load_nodes(&path).unwrap();
    let [gripper] = &nodes[..] else { panic!("{nodes:?}") };
    let values: Vec<_> = gripper
        .overrides
        .iter()
        .map(|entry| (entry.index, entry.subindex, entry.data.clone()))
        .collect();
    let watch = (100_u32 | 1 << 16).to_le_bytes().to_vec();
    assert_eq!(values, [(0x1029, 1, vec![2]), (0x1016, 1, watch)]);
    let steps: Vec<_> = gripper.boot.steps.iter().map(|step| step.action.to_string()).collect();
    assert!(steps[1].contains("write 0x1019:00 = 0x14"), "the SYNC counter: {steps:?}");
    let all = load_network(&path).unwrap();
    let titles: Vec<_> = all.nodes.iter().map(NodeDescription::title).collect();
    assert_eq!(titles, ["joint_1", "joint_2", "gripper"]);
}

/// 0x1016 and 0x1029, which the gripper does not have, before 0x1017.
const EXTRA: &str = "[1016]\nParameterName=Consumer heartbeat time\nObjectType=8\nSubNumber=2\n\
    [1016sub0]\nParameterName=Count\nDataType=5\nAccessType=ro\nDefaultValue=1\n\
    [1016sub1]\nParameterName=First\nDataType=7\nAccessType=rw\nDefaultValue=0\n\
    [1029]\nParameterName=Error behaviour\nObjectType=8\nSubNumber=2\n\
    [1029sub0]\nParameterName=Count\nDataType=5\nAccessType=ro\nDefaultValue=1\n\
    [1029sub1]\nParameterName=Communication\nDataType=5\nAccessType=rw\nDefaultValue=0\n\
    [1017]";

#[test]
fn unsuitable_drives_of_ros2_canopen_are_reported() {
    let text = "[[bus]]\ngateway = 0\nchannel = 0\nfile = \"bus.yml\"\n";
    let bus = DRIVES
        .replace("sync_period: 10000", "sync_period: 3000")
        .replace("position_mode: 1", "position_mode: 6")
        .replace("{index: 0x606C, sub_index: 0}", "{index: 0x6081, sub_index: 0}")
        .replace("heartbeat_consumer: true", "num_channels: 2");
    let found = faults_with(text, &[("bus.yml", &bus), ("servo_drive.eds", SERVO)]);
    has(&found, "`num_channels` is not supported");
    let bus = bus.replace("num_channels: 2", "num_channels: 1");
    let found = faults_with(text, &[("bus.yml", &bus), ("servo_drive.eds", SERVO)]);
    has(&found, "line 6, column 16: `sync_period` = 3000 must be a multiple of the cycle, 2000 us");
    has(&found, "mode 6 is invalid for an axis");
    has(&found, "0x6081:00: the TPDOs of an axis cannot contain it; allowed: 0x6041");
}
