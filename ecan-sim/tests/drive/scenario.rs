//! Drives connected to gateways: the built-in scenario, scenario files, and faults.

use std::path::Path;

use super::fixture::expand;
use crate::ecrt_support::{Program, frame, stepped};
use ecan_canopen::{DriveState, NmtState, NodeId};
use ecan_protocol::can::CanFrame;
use ecan_protocol::object::AbortCode;
use ecan_sim::{
    BackendError, ClockKind, DriveConfig, DriveFault, DriveQuirks, DriveSpec, EcrtSetting, Fault,
    MotorConfig, NodeKind, Scenario, ScriptedFault, SdoDirection, SdoEffect, SdoRule, SimOptions,
    When, drives, open, open_scenario,
};

fn id(node: u8) -> NodeId {
    NodeId::new(node).unwrap()
}

/// A program on some drives, with one slave per gateway.
fn program(scenario: Scenario) -> Program {
    let slaves = scenario.gateways.len();
    Program::new(stepped(scenario), &vec![3; slaves]).into_op()
}

/// Sends frames on channel 0 of slave 0, runs a few cycles and returns the received frames.
fn exchange(program: &mut Program, frames: &[CanFrame]) -> Vec<(u32, Vec<u8>)> {
    let before = program.received.len();
    let frames: Vec<_> = frames.iter().map(|frame| (0, 0, *frame)).collect();
    program.cycle_with(&frames);
    program.cycles(6);
    program.received[before..]
        .iter()
        .filter(|(slave, channel, _)| (*slave, *channel) == (0, 0))
        .map(|(_, _, frame)| (frame.id().raw(), frame.data().to_vec()))
        .collect()
}

#[test]
fn built_in_scenario_has_four_drives_per_channel() {
    let options = SimOptions {
        clock: Some(ClockKind::Stepped),
        gateways: vec![0; 3],
        ..SimOptions::default()
    };
    let setting = EcrtSetting::parse("sim:drives");
    let simulation = open(&setting, &options).unwrap().simulation.unwrap();
    assert!(simulation.banner().contains("Scenario drives: 3 gateways, 48 nodes"));
    simulation.with_world(|world| {
        assert_eq!(world.drives().count(), 48);
        for (gateway, channel, node) in [(0, 0, 1), (0, 3, 4), (2, 1, 3)] {
            let drive = world.drive_at(gateway, channel, id(node)).unwrap();
            let name = format!("drive {gateway}.{channel}/{node}");
            assert_eq!(world.drive_name(gateway, channel, id(node)), Some(name.as_str()));
            assert_eq!(world.drive(&name).unwrap().node_id(), drive.node_id());
            let position = 100_000 * gateway + 10_000 * channel + 1_000 * usize::from(node) + 7;
            assert_eq!(drive.position(), position as i32);
        }
        assert!(world.drive_at(0, 0, id(5)).is_none());
        assert!(world.drive_at(3, 0, id(1)).is_none());
        assert!(world.drive("drive").is_none());
    });
}

/// Startup of an axis: the frames that are sent (`>`) and received (`<`) in each step.
const STARTUP: &str = "\
# identity
> 601 40 18 10 01 00 00 00 00
< 581 43 18 10 01 00 4D 49 53
# RPDO 1: invalid
> 601 23 00 14 01 01 02 00 C0
< 581 60 00 14 01 00 00 00 00
# with every SYNC
> 601 2F 00 14 02 01 00 00 00
< 581 60 00 14 02 00 00 00 00
# no entries
> 601 2F 00 16 00 00 00 00 00
< 581 60 00 16 00 00 00 00 00
# controlword
> 601 23 00 16 01 10 00 40 60
< 581 60 00 16 01 00 00 00 00
# target position
> 601 23 00 16 02 20 00 7A 60
< 581 60 00 16 02 00 00 00 00
# two entries
> 601 2F 00 16 00 02 00 00 00
< 581 60 00 16 00 00 00 00 00
# valid
> 601 23 00 14 01 01 02 00 40
< 581 60 00 14 01 00 00 00 00
# TPDO 1: invalid
> 601 23 00 18 01 81 01 00 C0
< 581 60 00 18 01 00 00 00 00
# with every SYNC
> 601 2F 00 18 02 01 00 00 00
< 581 60 00 18 02 00 00 00 00
# no entries
> 601 2F 00 1A 00 00 00 00 00
< 581 60 00 1A 00 00 00 00 00
# statusword
> 601 23 00 1A 01 10 00 41 60
< 581 60 00 1A 01 00 00 00 00
# actual position
> 601 23 00 1A 02 20 00 64 60
< 581 60 00 1A 02 00 00 00 00
# two entries
> 601 2F 00 1A 00 02 00 00 00
< 581 60 00 1A 00 00 00 00 00
# valid
> 601 23 00 18 01 81 01 00 40
< 581 60 00 18 01 00 00 00 00
# CSP
> 601 2F 60 60 00 08 00 00 00
< 581 60 60 60 00 00 00 00 00
# operational
> 000 01 01
# shutdown
> 201 06 00 EF 03 00 00
> 080
< 181 40 02 EF 03 00 00
# switch on
> 201 07 00 EF 03 00 00
> 080
< 181 21 02 EF 03 00 00
# enable operation
> 201 0F 00 EF 03 00 00
> 080
< 181 33 02 EF 03 00 00
# first step
> 201 0F 00 53 04 00 00
> 080
< 181 37 12 EF 03 00 00
# it has followed
> 201 0F 00 53 04 00 00
> 080
< 181 37 12 53 04 00 00";

/// Identifiers and data of the frames in the lines that begin with this prefix.
fn frames_of(step: &str, prefix: &str) -> Vec<(u32, Vec<u8>)> {
    let lines = step.lines().filter_map(|line| line.strip_prefix(prefix));
    let frames = lines.map(|line| {
        let mut numbers = line.split(' ').map(|digits| u32::from_str_radix(digits, 16).unwrap());
        (numbers.next().unwrap(), numbers.map(|byte| byte as u8).collect())
    });
    frames.collect()
}

#[test]
fn axis_reaches_its_first_target() {
    let mut program = program(drives(1, 1));
    program.cycles(100);
    program.received.clear();
    for step in STARTUP.split("# ").skip(1) {
        // The motor stops before the next step.
        program.cycles(50);
        let requests = frames_of(step, "> ").into_iter();
        let requests: Vec<_> = requests.map(|(id, data)| frame(id as u16, &data)).collect();
        assert!(!requests.is_empty(), "{step}");
        assert_eq!(exchange(&mut program, &requests), frames_of(step, "< "), "{step}");
    }
    program.simulation().with_world(|world| {
        let drive = world.drive_at(0, 0, id(1)).unwrap();
        assert_eq!(drive.state(), DriveState::OperationEnabled);
        let sums = drive.targets().sums();
        assert_eq!((sums.firsts, sums.largest_first_offset, sums.largest_step), (1, 0, 100));
    });
}

/// Idle drives are not run at every controller tick; reading a drive must not show that.
#[test]
fn drive_state_is_as_of_its_last_tick() {
    let run = |steps: &[u64]| {
        let mut program = program(drives(1, 1));
        program.cycles(100);
        let sdo = |bytes: [u8; 8]| frame(0x601, &bytes);
        for request in [
            sdo([0x23, 0xFF, 0x60, 0, 0xA0, 0x86, 0x01, 0]),
            sdo([0x2F, 0x60, 0x60, 0, 3, 0, 0, 0]),
            sdo([0x2B, 0x40, 0x60, 0, 0x06, 0, 0, 0]),
            sdo([0x2B, 0x40, 0x60, 0, 0x07, 0, 0, 0]),
            sdo([0x2B, 0x40, 0x60, 0, 0x0F, 0, 0, 0]),
        ] {
            exchange(&mut program, &[request]);
        }
        let mut seen = Vec::new();
        for step_ns in steps {
            program.simulation().pass_ns(*step_ns);
            program.simulation().with_world(|world| {
                let drive = world.drive("drive 0.0/1").unwrap();
                assert_eq!(drive.state(), DriveState::OperationEnabled);
                seen.push((world.now_ns(), drive.mechanical_position(), drive.velocity()));
            });
        }
        seen
    };
    let fine = run(&[250_000; 160]);
    let coarse = run(&[10_000_000; 4]);
    assert_eq!(coarse, [fine[39], fine[79], fine[119], fine[159]]);
    assert!(coarse.is_sorted_by(|a, b| a.1 + 100.0 < b.1), "{coarse:?}");
    let ticks = fine.windows(2).filter(|pair| pair[0].1 != pair[1].1).count();
    assert!((39..=40).contains(&ticks), "{ticks} ticks in 40 ms");
}

#[test]
fn power_cycle_takes_drive_off_bus() {
    let mut program = program(drives(1, 2));
    program.cycles(100);
    program.received.clear();
    let node = "drive 0.0/1".to_owned();
    let fault = DriveFault::PowerCycle { off_ms: 50 };
    program.simulation().inject(Fault::Drive { node, fault });
    let sdo = frame(0x601, &[0x40, 0x00, 0x10, 0, 0, 0, 0, 0]);
    // the other drive acknowledges; this one does not respond
    assert_eq!(exchange(&mut program, &[sdo]), []);
    let errors = |program: &Program| {
        program.simulation().with_world(|world| world.bus_statistics(0, 0).unwrap().error_frames)
    };
    assert_eq!(errors(&program), 0);
    program.cycles(100);
    let boot_up = program.received.iter().position(|(_, _, frame)| frame.id().raw() == 0x701);
    assert_eq!(program.received[boot_up.unwrap()].2.data(), [0]);
    assert_eq!(exchange(&mut program, &[sdo]).len(), 1);
    // both off: no acknowledgement
    for node in ["drive 0.0/1", "drive 0.0/2"] {
        program.simulation().inject(Fault::Drive { node: node.to_owned(), fault });
    }
    exchange(&mut program, &[sdo]);
    assert!(errors(&program) > 0);
}

#[test]
fn faults_affect_named_drive() {
    let mut program = program(drives(1, 2));
    program.cycles(100);
    let inject = |program: &mut Program, node: u8, fault| {
        program.received.clear();
        let node = format!("drive 0.0/{node}");
        program.simulation().inject(Fault::Drive { node, fault });
        program.cycles(10);
        let frames: Vec<_> = program
            .received
            .iter()
            .map(|(_, _, frame)| (frame.id().raw(), frame.data().to_vec()))
            .collect();
        frames
    };
    let state = |program: &Program, node| {
        program.simulation().with_world(|world| world.drive_at(0, 0, id(node)).unwrap().state())
    };
    let frames = inject(&mut program, 2, DriveFault::Error { code: 0x2310 });
    assert_eq!(frames, [(0x082, vec![0x10, 0x23, 0x03, 0, 0, 0, 0, 0])]);
    assert_eq!(state(&program, 2), DriveState::Fault);
    assert_eq!(state(&program, 1), DriveState::SwitchOnDisabled);
    let frames = inject(&mut program, 1, DriveFault::Emcy { code: 0x4210, register: 9 });
    assert_eq!(frames, [(0x081, vec![0x10, 0x42, 0x09, 0, 0, 0, 0, 0])]);
    assert_eq!(state(&program, 1), DriveState::SwitchOnDisabled);
    // a name that does not exist
    assert_eq!(inject(&mut program, 9, DriveFault::Error { code: 0x2310 }), []);
    // silent: it runs, but sends nothing
    let node = "drive 0.0/1".to_owned();
    program.simulation().inject(Fault::NodeSilent { node, for_ms: 100 });
    let sdo = frame(0x601, &[0x40, 0x00, 0x10, 0, 0, 0, 0, 0]);
    assert_eq!(exchange(&mut program, &[sdo]), []);
    program.cycles(100);
    assert_eq!(exchange(&mut program, &[sdo]).len(), 1);
}

fn read(text: &str) -> Result<Scenario, String> {
    Scenario::from_toml(text, "test", Path::new("/cell")).map_err(|error| error.to_string())
}

const FILE: &str = r#"
[[gateway]]

[[node]]
kind = "drive"
bus = "0.1"
name = "shoulder"
node_id = 5
eds = "drive.eds"
bitrate = 1000000
serial = 99
boot_ms = 3000
sdo_delay_us = 1000
enable_ms = 20

[node.motor]
start_position = -5
max_velocity = 100000
absolute_encoder = false
limit_switches = [-10, 10]

[node.quirks]
rejects_mapping_while_valid = false
needs_mode = true
ignored_modes = [9]
missing = [0x1016]
sdo = [
  { index = 0x60C2, direction = "write", code = 0x06010000, times = 2 },
  { index = 0x1018, subindex = 1, silent = true },
]

[[node]]
kind = "drive"
bus = "0.0"
node_id = 5

[[fault]]
at_ms = 100
kind = "drive_error"
node = "shoulder"
code = 0x2310

[[fault]]
cycle = 5
kind = "drive_power_cycle"
node = "shoulder"
off_ms = 300

[[fault]]
cycle = 6
kind = "drive_emcy"
node = "shoulder"
code = 0x4210
register = 9

[[fault]]
cycle = 7
kind = "drive_blocked"
node = "shoulder"
for_ms = 50

[[fault]]
cycle = 8
kind = "drive_value"
node = "shoulder"
index = 0x60FD
value = 0x10000
"#;

#[test]
fn every_drive_key_is_read() {
    let scenario = read(FILE).unwrap();
    let NodeKind::Drive(drive) = &scenario.nodes[0].kind else { panic!() };
    let expected = DriveConfig {
        serial: 99,
        boot_ms: 3000,
        sdo_delay_us: 1000,
        enable_ms: 20,
        motor: MotorConfig {
            start_position: -5,
            max_velocity: 100_000,
            absolute_encoder: false,
            limit_switches: (-10, 10),
            ..MotorConfig::default()
        },
        quirks: DriveQuirks {
            rejects_mapping_while_valid: false,
            needs_mode: true,
            ignored_modes: vec![9],
            missing: vec![0x1016],
            sdo_rules: vec![
                SdoRule {
                    index: 0x60C2,
                    subindex: None,
                    direction: SdoDirection::Write,
                    effect: SdoEffect::Abort(AbortCode(0x0601_0000)),
                    times: Some(2),
                },
                SdoRule {
                    index: 0x1018,
                    subindex: Some(1),
                    direction: SdoDirection::Both,
                    effect: SdoEffect::Silence,
                    times: None,
                },
            ],
            ..DriveQuirks::default()
        },
        ..DriveConfig::new(id(5))
    };
    assert_eq!(**drive, DriveSpec { config: expected, eds: Some("/cell/drive.eds".into()) });
    assert_eq!(scenario.nodes[0].bitrate, Some(1_000_000));
    let NodeKind::Drive(plain) = &scenario.nodes[1].kind else { panic!() };
    assert_eq!(**plain, DriveSpec { config: DriveConfig::new(id(5)), eds: None });
    let fault = |when, fault| ScriptedFault {
        when,
        fault: Fault::Drive { node: "shoulder".to_owned(), fault },
    };
    assert_eq!(
        scenario.faults,
        [
            fault(When::At(100_000_000), DriveFault::Error { code: 0x2310 }),
            fault(When::Cycle(5), DriveFault::PowerCycle { off_ms: 300 }),
            fault(When::Cycle(6), DriveFault::Emcy { code: 0x4210, register: 9 }),
            fault(When::Cycle(7), DriveFault::Blocked { for_ms: 50 }),
            fault(
                When::Cycle(8),
                DriveFault::Value { index: 0x60FD, subindex: 0, value: 0x1_0000 }
            ),
        ]
    );
}

#[test]
fn drive_errors_are_reported() {
    let cases = [
        ("node_id = 5\neds", "eds", "a node of kind \"drive\" needs `node_id`"),
        (
            "node_id = 5\neds",
            "node_id = 128\neds",
            "`node_id` 128 is out of range; allowed: 1 to 127",
        ),
        (
            "kind = \"drive\"\nbus = \"0.0\"",
            "kind = \"echo\"\nbus = \"0.0\"",
            "`node_id` belongs to nodes of kind \"drive\"",
        ),
        ("bus = \"0.0\"", "bus = \"0.1\"", "node-ID 5 is already used by \"shoulder\""),
        ("max_velocity = 100000", "max_velocity = 0", "`max_velocity` = 0 is out of range"),
        ("[-10, 10]", "[10, -10]", "the negative limit switch must be below the positive one"),
        ("needs_mode = true", "need_mode = true", "unknown field `need_mode`"),
        (", silent = true", "", "an `sdo` quirk needs either `code` or `silent = true`"),
        (
            "code = 0x2310",
            "code = 0x12310",
            "`code` of `drive_error` is out of range; allowed: 0 to 0xFFFF",
        ),
        ("for_ms = 50", "", "`drive_blocked` needs `for_ms`"),
        ("value = 0x10000", "", "`drive_value` needs `value`"),
        (
            "for_ms = 50",
            "for_ms = 50\nregister = 1",
            "`register` does not belong to `drive_blocked`; allowed: node, for_ms",
        ),
    ];
    for (old, new, text) in cases {
        assert!(FILE.contains(old), "{old}");
        let error = read(&FILE.replacen(old, new, 1)).unwrap_err();
        assert!(error.contains(text), "{error}");
        assert!(error.starts_with("line "), "{error}");
    }
    let text = FILE.replace(
        "kind = \"drive\"\nbus = \"0.0\"\nnode_id = 5",
        "kind = \"echo\"\nname = \"e\"\nbus = \"0.0\"",
    );
    let text = text.replace("node = \"shoulder\"\ncode", "node = \"e\"\ncode");
    assert!(read(&text).unwrap_err().contains("node \"e\" is not a drive"));
}

#[test]
fn missing_or_invalid_eds_is_reported() {
    let directory = std::env::temp_dir().join(format!("ecan-drive-{}", std::process::id()));
    std::fs::create_dir_all(&directory).unwrap();
    let path = directory.join("wrong.eds");
    std::fs::write(
        &path,
        "[1000]\nDataType=7\nParameterValue=none\n[1001]\nDataType=5\nParameterValue=x\n",
    )
    .unwrap();
    let mut scenario = drives(1, 1);
    for (file, text) in [
        (path.clone(), "wrong.eds, line 3: `ParameterValue`: `none` is not a number; "),
        (path.clone(), "; line 6: `ParameterValue`: `x` is not a number; "),
        (directory.join("absent.eds"), "absent.eds: "),
    ] {
        let config = DriveConfig::new(id(1));
        scenario.nodes[0].kind = NodeKind::Drive(Box::new(DriveSpec { config, eds: Some(file) }));
        let error = open_scenario(scenario.clone(), &SimOptions::default()).unwrap_err();
        assert!(error.to_string().contains(text), "{error}");
        assert!(matches!(error, BackendError::DeviceFile(..) | BackendError::Read(..)));
    }
    std::fs::remove_dir_all(&directory).unwrap();
}

/// A module without motor: its input is sent when it changes.
#[test]
fn module_of_scenario_file_sends_changed_input() {
    let directory = std::env::temp_dir().join(format!("ecan-module-{}", std::process::id()));
    std::fs::create_dir_all(&directory).unwrap();
    std::fs::write(directory.join("module.dcf"), expand(super::eds::MODULE)).unwrap();
    let text = "[[gateway]]\n[[node]]\nkind = \"drive\"\nbus = \"0.0\"\nname = \"module\"\n\
                node_id = 5\ndcf = \"module.dcf\"\n";
    let scenario = Scenario::from_toml(text, "test", &directory).unwrap();
    let mut program = program(scenario);
    program.cycles(100);
    assert_eq!(exchange(&mut program, &[frame(0, &[1, 5])]), [(0x185, vec![0])]);
    let input = DriveFault::Value { index: 0x6000, subindex: 1, value: 0x81 };
    let fault = Fault::Drive { node: "module".to_owned(), fault: input };
    assert_eq!(fault.to_string(), "drive \"module\": object 0x6000:01 becomes 129");
    program.simulation().inject(fault);
    assert_eq!(exchange(&mut program, &[]), [(0x185, vec![0x81])]);
    let output = |program: &Program| {
        program.simulation().with_world(|world| world.drive("module").unwrap().object(0x6200, 1))
    };
    assert_eq!(exchange(&mut program, &[frame(0x205, &[0x0F])]), []);
    assert_eq!(output(&program), Some(0x0F));
    std::fs::remove_dir_all(&directory).unwrap();
}

#[test]
fn drive_with_own_bit_rates_runs_without_gateway() {
    let text = FILE.replace("eds = \"drive.eds\"\n", "").replace("boot_ms = 3000", "boot_ms = 30");
    let program = Program::new(stepped(read(&text).unwrap()), &[3]);
    program.simulation().pass_ns(50_000_000);
    program.simulation().with_world(|world| {
        let state = |name| world.drive(name).unwrap().nmt_state();
        assert_eq!(state("shoulder"), NmtState::PreOperational);
        // the other one follows a channel that is not configured
        assert_eq!(state("node 1"), NmtState::Initialising);
    });
}
