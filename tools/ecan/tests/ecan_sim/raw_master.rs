//! The program on one end of a veth pair, a hand-written master on the other.

use super::support::network::{self, GATEWAYS, MASTER};
use super::support::program::Running;
use super::support::raw_master::{APRD, BRD, FPRD, RawMaster, frame};
use nix::sys::signal::Signal;

/// The program and a master, after the gateways have booted.
fn begin(arguments: &[&str], gateways: u16) -> Option<(Running, RawMaster)> {
    if !network::enter() {
        return None;
    }
    let mut program = Running::start(arguments);
    program.wait_for(&format!("gateway {}: booted, INIT", gateways - 1));
    let master = RawMaster::open(MASTER);
    master.wait_for_link();
    Some((program, master))
}

#[test]
fn two_gateways_answer_and_reach_preop() {
    let Some((mut program, mut master)) = begin(&["--gateways", "2"], 2) else { return };
    let (_, counter) = master.read(BRD, 0, 0x0000, 1);
    assert_eq!(counter, 2);
    program.wait_for("first EtherCAT frame");
    let stations = [0, 1].map(|position| master.bring_to_preop(position));
    assert_eq!(stations, [0x1001, 0x1002]);
    program.wait_for("gateway 0: INIT -> PREOP");
    program.wait_for("gateway 1: INIT -> PREOP");
    for station in stations {
        assert_eq!(master.upload(station, 0xF000, 2), [4], "four CAN channels");
        assert_eq!(master.upload(station, 0xF000, 17), [128, 0], "bytes of a chunk");
    }
    // SAFEOP needs process data.
    master.write(0x1002, 0x0120, &[4, 0]);
    master.read_until((FPRD, 0x1002, 0x0130, 6), |data, _| (data[0], data[4]) == (0x12, 0x1D));
    program.wait_for("gateway 1: PREOP, AL error 0x001D invalid output configuration");
    master.write(0x1002, 0x0120, &[0x12, 0]);
    program.wait_for("gateway 1: PREOP, AL error acknowledged");

    // Two invalid frames: torn, and of another type.
    let whole = frame(BRD, 0, 0, 0, &[0; 8]);
    master.send(&whole[..whole.len() - 1]);
    assert_eq!(master.receive().len(), whole.len() - 1, "it returns unchanged");
    let (_, counter) = master.read(APRD, 0, 0x030C, 1);
    assert_eq!(counter, 1);

    let printed = program.end(Signal::SIGINT);
    assert!(printed.starts_with("SIMULATED: no gateway, no CAN bus is real"), "{printed}");
    let counters = printed.lines().find(|line| line.starts_with("frames: ")).unwrap();
    assert!(counters.contains(" EtherCAT, 1 faulty, 0 foreign, 0 lost; 0 dropped"), "{counters}");
    let frames: u64 = counters.split(' ').nth(1).unwrap().parse().unwrap();
    assert!(frames > 20, "{counters}");
    for part in ["turnaround: median ", "p99 ", "gateway 1: PREOP", "can3 on bus 1.3: 0 sent"] {
        assert!(printed.contains(part), "{part}: {printed}");
    }
}

#[test]
fn scenario_faults_are_reported_and_effective() {
    let directory = tempfile::tempdir().unwrap();
    let scenario = directory.path().join("cell.toml");
    let toml = "[[gateway]]\n[[gateway]]\n[[gateway]]\n\
                [[node]]\nkind = \"bridge\"\nbus = \"1.2\"\nprotocol = \"slcan\"\n\
                [[fault]]\nkind = \"power_off\"\ngateway = 2\nat_ms = 1500\n";
    std::fs::write(&scenario, toml).unwrap();
    let file = scenario.to_str().unwrap();
    let arguments = ["--scenario", file, "--gateways", "2", "--seed", "9"];
    let Some((mut program, mut master)) = begin(&arguments, 3) else { return };
    program.wait_for("gateway 2: off or restarting");
    master.read_until((BRD, 0, 0x0000, 1), |_, counter| counter == 2);
    let printed = program.end(Signal::SIGTERM);
    assert!(printed.contains("--gateways 2 is ignored"), "{printed}");
    assert!(printed.contains("    1.500 s  fault: gateway 2 without supply\n"), "{printed}");
    assert!(printed.contains("3 gateways, 1 node, on interface veth1, seed 9"), "{printed}");
    assert!(printed.contains(", slcan bridge at 127.0.0.1:"), "{printed}");
    assert!(printed.contains(" on bus 1.2\n"), "{printed}");
}

#[test]
fn quiet_dump_on_standard_output_contains_only_data() {
    if !network::enter() {
        return;
    }
    let arguments = ["wire", "--interface", GATEWAYS, "--dump", "-", "--duration", "0.4s"];
    let output = super::support::program::run(&arguments);
    assert!(output.status.success());
    assert_eq!(super::support::program::text(&output.stdout), "", "no CAN frame, nothing");
    let messages = super::support::program::text(&output.stderr);
    assert!(messages.contains("SIMULATED") && messages.contains("booted"), "{messages}");
    assert!(messages.contains("no frame answered"), "{messages}");

    let output = super::support::program::run(&[
        "wire",
        "-i",
        GATEWAYS,
        "--quiet",
        "--spin",
        "--duration",
        "0.4s",
    ]);
    let printed = super::support::program::text(&output.stdout);
    assert!(printed.starts_with("SIMULATED") && printed.contains("frames: 0"), "{printed}");
    assert!(!printed.contains("booted"), "{printed}");
}

#[test]
fn interface_may_go_down_but_not_away() {
    let Some((mut program, mut master)) = begin(&[], 1) else { return };
    network::ip(&["link", "set", GATEWAYS, "down"]);
    program.wait_for("veth1 is down: no frames until it is up");
    network::ip(&["link", "set", GATEWAYS, "up"]);
    master.wait_for_link();
    let (_, counter) = master.read(BRD, 0, 0x0000, 1);
    assert_eq!(counter, 1);
    program.wait_for("veth1 is up again");
    network::ip(&["link", "del", GATEWAYS]);
    let message = program.fail();
    assert!(message.contains("network interface veth1 was removed"), "{message}");
}

#[test]
fn removed_interface_is_reported() {
    let Some((mut program, _master)) = begin(&[], 1) else { return };
    network::ip(&["link", "set", GATEWAYS, "down"]);
    program.wait_for("veth1 is down: no frames until it is up");
    network::ip(&["link", "del", GATEWAYS]);
    let message = program.fail();
    assert!(message.contains("network interface veth1 was removed"), "{message}");
}
