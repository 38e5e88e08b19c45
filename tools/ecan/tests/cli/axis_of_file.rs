//! `ecan axis` with the network and the gateways of a configuration file.

use std::process::Command;
use std::time::{Duration, Instant};

use serde_json::Value;

use crate::axis::LIMITS;
use crate::axis_terminal::OBSERVED;
use crate::support::observed_bus::ObservedBus;
use crate::support::{Running, Scenario, ecan, scenario, setting};

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
    let begin = Instant::now();
    while bus.frames("764").len() < 5 || bus.frames("100").len() < 2 || bus.frames("080").len() < 22
    {
        assert!(begin.elapsed() < Duration::from_secs(20), "{}", enable.errors());
        std::thread::sleep(Duration::from_millis(5));
    }
    assert!(bus.frames("764").iter().all(|state| state.starts_with("05")), "operational");
    assert!(bus.frames("77F").is_empty(), "the default is node 127");
    let counter = |data: &String| u8::from_str_radix(data.get(..2)?, 16).ok();
    let counters: Option<Vec<_>> = bus.frames("080").iter().map(counter).collect();
    let counters = counters.expect("each SYNC has a counter");
    let follows = |pair: &[u8]| pair[1] == pair[0] % 10 + 1;
    assert!(counters.windows(2).all(follows), "{counters:?}");
    enable.terminate();
    let (status, errors) = enable.wait();
    assert_eq!(status, Some(0), "{errors}");
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
