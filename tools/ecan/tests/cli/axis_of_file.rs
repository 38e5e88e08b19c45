//! `ecan axis` with the network and the gateways of a configuration file.

use std::process::Command;

use serde_json::Value;

use crate::axis::LIMITS;
use crate::axis_terminal::OBSERVED;
use crate::support::observed_bus::ObservedBus;
use crate::support::{
    Running, Scenario, assert_has, ecan, fails, good, json_of, scenario, setting, wait_for,
};

const AXIS: &str = "[[axis]]\ngateway = 0\nchannel = 0\nnode = 1\nsteps_per_turn = 65536\n";
const ALONE: [&str; 4] = ["--axis", "0", "--yes", "--unattended"];

/// A file with one axis and these keys in its table `[network]`.
fn file_with(network: &str) -> String {
    format!(
        "cycle_us = 2000\n[[gateway]]\nn = 4\ncan0 = {{ bitrate = 500000 }}\n\
         [network]\n{network}\n{AXIS}"
    )
}

#[test]
fn network_of_the_file_is_on_the_bus() {
    let bus_file = scenario(OBSERVED);
    let setting = setting(&bus_file);
    let file = scenario(&file_with(
        "host_node = 100\nhost_heartbeat_ms = 20\nsync_cycles = 5\nsync_counter = 10\ntime_ms = 40",
    ));
    let path = file.path().display().to_string();
    let mut command = Command::new(env!("CARGO_BIN_EXE_ecan"));
    command
        .args(["--ecrt", &setting])
        .args(["axis", "enable", "--config", &path, "--for", "60000"]);
    command.args(ALONE).args(LIMITS);
    let mut enable = Running::spawn(&mut command);
    enable.wait_for_error(" on bus ");
    let bus = ObservedBus::connect(&enable.errors());
    enable.wait_for_error("enabled for 60000 ms");
    for (id, count) in [("764", 5), ("100", 2), ("080", 22)] {
        wait_for(id, || bus.frames(id).len() >= count);
    }
    assert!(bus.frames("764").iter().all(|state| state.starts_with("05")), "operational");
    assert!(bus.frames("77F").is_empty(), "the default is node 127");
    let counter = |data: &String| u8::from_str_radix(data.get(..2)?, 16).ok();
    let counters: Option<Vec<_>> = bus.frames("080").iter().map(counter).collect();
    let counters = counters.expect("each SYNC has a counter");
    let follows = |pair: &[u8]| pair[1] == pair[0] % 10 + 1;
    assert!(counters.windows(2).all(follows), "{counters:?}");
    enable.end();
}

#[test]
fn drive_without_the_heartbeat_of_the_file_is_rejected() {
    let drive =
        Scenario::new("[[node]]\nkind = \"drive\"\nname = \"x\"\nbus = \"0.0\"\nnode_id = 1\n");
    let run = |network: &str| {
        let path = drive.write("machine.toml", &file_with(network));
        let to = ["axis", "move", "--mode", "pp", "--to", "5", "--config", &path];
        let output = drive.run(&[&to[..], &ALONE, &LIMITS].concat());
        (output.status.code(), String::from_utf8(output.stderr).unwrap())
    };
    // It watches the heartbeat of the configured node.
    let (status, errors) = run("host_node = 100");
    assert!(status == Some(0) && errors.contains("if this host fails: quick stop"), "{errors}");
    let (status, errors) = run("host_heartbeat_ms = 0");
    assert_eq!(status, Some(5), "{errors}");
    let expected =
        "its motor would not stop if this host fails: runs on, the host sends no heartbeat";
    assert!(errors.contains(expected), "{errors}");
}

#[test]
fn axis_of_a_file_has_the_gateway_of_the_file() {
    let bus = scenario(
        "[[gateway]]\n[[gateway]]\nalias = 7\n\
         [[node]]\nkind = \"drive\"\nname = \"x\"\nbus = \"1.0\"\nnode_id = 1\n",
    );
    let gateways = |second: &str| {
        let axis = AXIS.replace("gateway = 0", "gateway = 1");
        format!(
            "[[gateway]]\nn = 4\ncan0 = {{ bitrate = 500000 }}\n\
             [[gateway]]\n{second}\nn = 4\ncan0 = {{ bitrate = 500000 }}\n{axis}"
        )
    };
    let setting = setting(&bus);
    let ended = |second: &str, more: &[&str]| {
        let file = scenario(&gateways(second));
        let path = file.path().display().to_string();
        let status =
            ["--json", "--ecrt", &setting, "axis", "status", "--axis", "0", "--config", &path];
        ecan(&[&status[..], more].concat())
    };
    for second in ["alias = 7", "position = 1"] {
        let output = ended(second, &[]);
        let errors = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "{second}: {errors}");
        let status: Value = serde_json::from_slice(&output.stdout).unwrap();
        assert_eq!(status["state"], "switch on disabled", "{second}: {status}");
    }
    for (second, more, expected) in [
        ("alias = 6\nposition = 1", &[][..], "is 1 after alias 6; select it with --slave"),
        ("alias = 7", &["--slave", "0"], "the axis determines its gateway"),
    ] {
        let output = ended(second, more);
        let errors = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(2), "{errors}");
        assert!(errors.contains(expected), "{errors}");
    }
}

/// A drive with two axes that does not have some objects.
fn two_axes(missing: &str) -> Scenario {
    Scenario::new(&format!(
        "[[node]]\nkind = \"drive\"\nname = \"x\"\nbus = \"0.0\"\nnode_id = 1\naxes = 2\n\
         quirks = {{ missing = {missing} }}\n"
    ))
}

/// A file with both axes of the drive.
const SHARED: &str = "[[gateway]]\nn = 4\ncan0 = { bitrate = 500000 }\n\
    [[node]]\nname = \"gantry\"\ngateway = 0\nchannel = 0\nnode = 1\n\
    [[node.axis]]\nsteps_per_turn = 65536\n\
    [[node.axis]]\nsteps_per_turn = 65536\npdo_number = 65\n\
    rpdo_cob_ids = [0x341]\ntpdo_cob_ids = [0x2C1]\n";

#[test]
fn axis_of_a_drive_with_several_is_moved() {
    // The first axis has neither the target of CSP nor the velocity of PP.
    let drive = two_axes("[0x607A, 0x6081]");
    let setting = drive.setting();
    let file = scenario(SHARED);
    let path = file.path().display().to_string();
    let of_node = ["--node", "1", "--steps-per-turn", "65536", "--node-axis"];
    let of_file = ["--config", &path, "--axis"];
    let limits = [&["--yes", "--unattended", "--to", "30"][..], &LIMITS].concat();
    let arguments = |mode: &'static str| {
        [&["--json", "--ecrt", &setting, "axis", "move", "--mode", mode], &limits[..]].concat()
    };
    for mode in ["csp", "pp"] {
        for (axis, label) in [
            ([&of_node[..], &["1"]].concat(), "axis 1 of node 1 on can0"),
            ([&of_file[..], &["gantry/1"]].concat(), "axis gantry/1 (node 1 on can0)"),
        ] {
            let moved = good(&[&arguments(mode)[..], &axis].concat());
            let report = json_of(&moved);
            assert_eq!(report["axis"], label);
            assert!((report["end"].as_f64().unwrap() - 30.0).abs() < 0.05, "{mode}: {report}");
        }
        for axis in [[&of_node[..], &["0"]].concat(), [&of_file[..], &["gantry/0"]].concat()] {
            assert_has(&fails(5, &[&arguments(mode)[..], &axis].concat()), "node 1 on can0");
        }
    }
}

#[test]
fn status_of_an_axis_reads_its_objects() {
    let drive = two_axes("[0x6864]");
    let setting = drive.setting();
    let status = ["--ecrt", &setting, "axis", "status", "--node", "1", "--node-axis"];
    assert_has(&good(&[&status[..], &["0"]].concat()), "position         0 step");
    let second = good(&[&status[..], &["1"]].concat());
    assert!(second.contains("axis 1 of node 1 on can0"), "{second}");
    assert!(second.contains("position         not reported"), "{second}");
    assert_has(&fails(5, &[&status[..], &["2"]].concat()), "no statusword 0x7041");
    assert_has(&fails(2, &[&status[..], &["8"]].concat()), "--node-axis");
}

#[test]
fn obstacles_to_enabling_are_read_from_the_axis() {
    // The first axis is in fault, the second one is enabled too late.
    let drive = Scenario::new(
        "[[node]]\nkind = \"drive\"\nname = \"x\"\nbus = \"0.0\"\nnode_id = 1\naxes = 2\n\
         enable_ms = 60000\n\
         [[fault]]\nafter_ready_ms = 1\nkind = \"drive_error\"\nnode = \"x\"\ncode = 0x7121\n",
    );
    let setting = drive.setting();
    let obstacles = |axis: &str| {
        let enable = ["--ecrt", &setting, "axis", "enable", "--node", "1", "--node-axis", axis];
        let options = ["--steps-per-turn", "65536", "--for", "10", "--yes", "--unattended"];
        fails(5, &[&enable[..], &options, &LIMITS].concat())
    };
    let fault = "the drive is in fault: error code 0x7121 motor blocked";
    let (first, second) = (obstacles("0"), obstacles("1"));
    assert!(first.contains(fault), "{first}");
    assert!(second.contains("axis 1 of node 1 on can0: "), "{second}");
    assert!(second.contains("  1. ") && !second.contains(fault), "{second}");
}
