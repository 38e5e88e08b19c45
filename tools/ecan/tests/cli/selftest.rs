//! Tests of `ecan selftest`.

use std::io::{BufRead as _, BufReader, Read as _};
use std::process::{Command, Stdio};

use crate::support::{
    Scenario, assert_has, ecan, ends, fails, good, json_of, scenario, setting, simulated,
};
use ecan_test_support::Killed;
use rustix::process::{Pid, Signal, kill_process};

/// Gateway with channels 0 and 1, and 2 and 3, wired together.
const WIRED: &str = "[[gateway]]\nbuses = [\"a\", \"a\", \"b\", \"b\"]\n";
/// One bit rate with CAN FD, and one without.
const CELL: &str = "[[gateway]]\nn = 5\n[gateway.can0]\nbitrate = 500000\n\
                    data_bitrate = 2000000\nsample_point = 80\n[gateway.can2]\nbitrate = 250000\n";

/// Lines of the checks with this name.
fn lines<'a>(printed: &'a str, word: &str) -> Vec<&'a str> {
    printed.lines().map(str::trim).filter(|line| line.contains(word)).collect()
}

fn cell() -> tempfile::NamedTempFile {
    scenario(CELL)
}

fn path(file: &tempfile::NamedTempFile) -> String {
    file.path().display().to_string()
}

#[test]
fn every_channel_is_tested_by_loopback() {
    let cell = cell();
    let printed = simulated(&["selftest", "--config", &path(&cell)]);
    let expected = "\
gateway 4294967297 at position 0: passed
  good    recognition                                ECAN-Lite (0xF000)
  good    identity                                   vendor 0x00004543, product 0x4C495445, revision 0x00020002
  good    firmware                                   2.2.1
  good    serial number                              4294967297
  good    loopback of channel 0, 500/2000 kbit/s FD  96 frames, no errors
  good    loopback of channel 1, 500/2000 kbit/s FD  96 frames, no errors
  good    loopback of channel 2, 500/2000 kbit/s FD  96 frames, no errors
  good    loopback of channel 3, 500/2000 kbit/s FD  96 frames, no errors
  good    loopback of channel 0, 250 kbit/s          96 frames, no errors
  good    loopback of channel 1, 250 kbit/s          96 frames, no errors
  good    loopback of channel 2, 250 kbit/s          96 frames, no errors
  good    loopback of channel 3, 250 kbit/s          96 frames, no errors
  good    configuration                              as before the test, by a restart
";
    assert_eq!(printed, expected);
}

#[test]
fn restart_replaces_the_comparison() {
    let (cell, setting) = (cell(), "sim");
    let options = ["--ecrt", setting, "selftest", "--restart", "--config", &path(&cell)];
    let printed = good(&options);
    assert!(printed.ends_with("  as saved, by a restart\n"), "{printed}");
    assert_eq!(lines(&printed, "96 frames, no errors").len(), 8, "{printed}");
}

#[test]
fn gateways_pass_at_the_pace_of_igh() {
    let bus = scenario("[master]\nlike = \"igh\"\n[[gateway]]\n[[gateway]]\n");
    let (ecrt, cell) = (setting(&bus), cell());
    let printed = good(&["--ecrt", &ecrt, "selftest", "--config", &path(&cell)]);
    assert_eq!(lines(&printed, ": passed").len(), 2, "{printed}");
}

#[test]
fn default_bit_rates_are_tested() {
    let printed = simulated(&["selftest", "--channels", "1,3", "--frames", "8"]);
    for rate in ["125", "250", "500", "1000"] {
        let line = format!("loopback of channel 3, {rate} kbit/s ");
        assert_eq!(lines(&printed, &line).len(), 1, "{printed}");
    }
    for rate in ["500/2000 kbit/s FD", "1000/5000 kbit/s FD"] {
        let line = format!("loopback of channel 1, {rate}");
        assert_eq!(lines(&printed, &line).len(), 1, "{printed}");
    }
    assert_eq!(lines(&printed, "loopback").len(), 12);
    assert_eq!(lines(&printed, "8 frames, no errors").len(), 12);
}

#[test]
fn wired_channels_are_tested_in_both_directions() {
    let bus = scenario(WIRED);
    let ecrt = setting(&bus);
    let printed = good(&["--ecrt", &ecrt, "selftest", "--wired", "0-1,3-2", "--frames", "256"]);
    let wires = lines(&printed, "wire from");
    assert_eq!(wires.len(), 24, "{printed}");
    for (from, to) in [(0, 1), (1, 0), (2, 3), (3, 2)] {
        let way = format!("wire from channel {from} to {to}, ");
        assert_eq!(wires.iter().filter(|line| line.contains(&way)).count(), 6, "{printed}");
    }
    assert!(wires.iter().all(|line| line.ends_with("256 frames, no errors")), "{printed}");
}

#[test]
fn channel_without_partner_fails() {
    let bus = scenario("[[gateway]]\nbuses = [\"a\", \"a\", \"b\", \"c\"]\n");
    let (ecrt, cell) = (setting(&bus), cell());
    let arguments = ["--ecrt", &ecrt, "selftest", "--config", &path(&cell), "--wired", "0-1,2-3"];
    let printed = ends(1, &arguments);
    assert!(printed.starts_with("gateway 4294967297 at position 0: FAILED\n"), "{printed}");
    let failed = lines(&printed, "FAILED  wire");
    assert_eq!(failed.len(), 4, "{printed}");
    let text = "FAILED  wire from channel 2 to 3, 250 kbit/s          0 of 96 frames received (no \
                 acknowledgement; check the wiring from channel 2 to channel 3 and its termination); \
                 channel 2: error counters 128 transmit errors, 0 receive errors, 16 logged, last error \
                 acknowledge error; channel 3: error counters 128 transmit errors, 0 receive errors, 16 \
                 logged, last error acknowledge error";
    assert_eq!(lines(&printed, "wire from channel 2 to 3, 250"), [text]);
    assert_eq!(lines(&printed, "good    wire from channel 0 to 1").len(), 2, "{printed}");
    assert_eq!(lines(&printed, "good    loopback").len(), 8, "{printed}");
    assert_eq!(lines(&printed, "good    configuration").len(), 1, "{printed}");
}

#[test]
fn corrupting_node_fails_only_its_bus() {
    let node = "[[node]]\nkind = \"faulty\"\nbus = \"a\"\ncorrupt_permille = 1000\n";
    let bus = scenario(&format!("{WIRED}{node}"));
    let (ecrt, cell) = (setting(&bus), cell());
    let arguments = ["--ecrt", &ecrt, "selftest", "--config", &path(&cell), "--wired", "0-1,2-3"];
    let printed = ends(1, &arguments);
    let failed = lines(&printed, "FAILED  wire");
    assert_eq!(failed.len(), 4, "{printed}");
    for line in failed {
        assert!(line.contains("from channel 0 to 1") || line.contains("from channel 1 to 0"));
        assert!(line.contains(" frames received with errors, the first: byte "), "{line}");
        assert!(line.contains(": sent 0x"), "{line}");
        let strange = "from another sender; check for other nodes on its bus";
        assert!(line.contains(strange), "{line}");
    }
    assert_eq!(lines(&printed, "good    wire from channel 2 to 3").len(), 2, "{printed}");
}

#[test]
fn bus_off_channel_fails() {
    let faults: String = (0..1000)
        .map(|at| {
            let at_ms = at * 10;
            format!("[[fault]]\nkind = \"bus_off\"\ngateway = 0\nchannel = 1\nat_ms = {at_ms}\n")
        })
        .collect();
    let bus = scenario(&format!("{WIRED}{faults}"));
    let (ecrt, cell) = (setting(&bus), cell());
    let arguments = ["--ecrt", &ecrt, "selftest", "--config", &path(&cell), "--wired", "0-1,2-3"];
    let printed = ends(1, &arguments);
    let failed = lines(&printed, "FAILED  wire from channel 0 to 1");
    assert!(!failed.is_empty(), "{printed}");
    assert!(failed.iter().all(|line| line.contains("channel 1 went bus-off")), "{printed}");
    assert_eq!(lines(&printed, "good    wire from channel 2 to 3").len(), 2, "{printed}");
}

#[test]
fn rejected_configuration_fails_and_next_is_tested() {
    let fault = "[[fault]]\nkind = \"sdo_abort\"\ngateway = 0\nindex = 0x8002\nsubindex = 1\n\
                 code = 0x06090030\ntimes = 1000\nat_ms = 0\n";
    let bus = scenario(&format!("[[gateway]]\n[[gateway]]\n{fault}"));
    let (ecrt, cell) = (setting(&bus), cell());
    let printed = ends(1, &["--ecrt", &ecrt, "selftest", "--config", &path(&cell)]);
    assert!(printed.starts_with("gateway 4294967297 at position 0: FAILED\n"), "{printed}");
    let failed = lines(&printed, "FAILED  loopback, 500/2000 kbit/s FD");
    assert_eq!(failed.len(), 1, "{printed}");
    assert!(failed.iter().all(|line| line.contains("0x06090030")), "{printed}");
    assert_eq!(lines(&printed, "gateway 4294967298 at position 1: passed").len(), 1, "{printed}");
}

#[test]
fn lost_gateway_fails_even_if_it_recovers() {
    // At this bit rate the test takes over a second: the fault occurs in the middle.
    let slow = scenario("[[gateway]]\nn = 8\ncan0 = { bitrate = 20_000 }\n");
    let fault = "[[fault]]\nkind = \"al_error\"\ngateway = 0\ncode = 26\ncycle = 1500\n";
    let bus = scenario(&format!("[[gateway]]\n{fault}"));
    let (ecrt, slow) = (setting(&bus), path(&slow));
    let options = ["--ecrt", &ecrt, "selftest", "--config", &slow, "--frames", "255"];
    let printed = ends(1, &options);
    // If the gateway is not ready before the end of the test, frames are missing.
    let failed = lines(&printed, "FAILED  ");
    let tells = |line: &&str| {
        line.contains("the gateway was lost") || line.contains(" of 255 frames received")
    };
    assert!(!failed.is_empty() && failed.iter().all(tells), "{printed}");
    assert!(!printed.contains("this computer"), "{printed}");
    assert_eq!(lines(&printed, "good    configuration").len(), 1, "{printed}");
}

#[test]
fn temporarily_lost_gateway_is_restored() {
    // At these bit rates the test takes some seconds: the fault occurs in the middle. The last gateway,
    // so that the link to the other one stays.
    let slow = "[[gateway]]\nn = 8\ncan0 = { bitrate = 10_000 }\ncan1 = { bitrate = 20_000 }\n";
    let slow = scenario(slow);
    let fault = "[[fault]]\nkind = \"power_cycle\"\ngateway = 1\noff_ms = 200\ncycle = 4000\n";
    let bus = scenario(&format!("[[gateway]]\n[[gateway]]\n{fault}"));
    let (ecrt, slow) = (setting(&bus), path(&slow));
    let options = ["--ecrt", &ecrt, "selftest", "--config", &slow, "--frames", "255"];
    let printed = ends(1, &options);
    assert!(printed.starts_with("gateway 4294967297 at position 0: passed\n"), "{printed}");
    assert_eq!(lines(&printed, "gateway 4294967298 at position 1: FAILED").len(), 1, "{printed}");
    assert_eq!(lines(&printed, "good    configuration").len(), 2, "{printed}");
}

#[test]
fn unidentified_gateway_fails() {
    let bus = crate::support::first_silent();
    let printed = ends(1, &["--ecrt", &setting(&bus), "selftest", "--frames", "1"]);
    assert!(printed.starts_with("slave at position 0: FAILED\n"), "{printed}");
    assert_eq!(lines(&printed, "FAILED  recognition").len(), 1, "{printed}");
    assert_eq!(lines(&printed, "gateway 4294967298 at position 1: passed").len(), 1, "{printed}");
}

#[test]
fn removed_gateway_fails_others_keep_reports() {
    // Before the gateways are in operation.
    let fault = "[[fault]]\nkind = \"power_off\"\ngateway = 1\nat_ms = 2800\n";
    let bus = scenario(&format!("[[gateway]]\n[[gateway]]\n{fault}"));
    let printed = ends(1, &["--ecrt", &setting(&bus), "selftest"]);
    assert!(printed.starts_with("gateway 4294967297 at position 0: "), "{printed}");
    assert!(printed.starts_with("gateway 4294967297 at position 0: passed\n"), "{printed}");
    assert_eq!(lines(&printed, "gateway 4294967298 at position 1: FAILED").len(), 1, "{printed}");
    let failed = lines(&printed, "FAILED  loopback");
    assert_eq!(failed.len(), 1, "{printed}");
    assert!(failed.iter().all(|line| line.contains("not on the bus")), "{printed}");
}

#[test]
fn stopped_test_has_report_and_restores() {
    let bus = Scenario::new("");
    bus.write("bus.toml", "clock = \"real\"\n[[gateway]]\n[[gateway]]\n");
    let setting = bus.setting();
    let reports = bus.path("reports");
    let log = "ecan::commands::selftest=info";
    let arguments = ["--ecrt", &setting, "--log", log, "selftest", "--report", &reports];
    let mut command = Command::new(env!("CARGO_BIN_EXE_ecan"));
    command.args(arguments).env_remove("ECAN_ECRT").stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut child = Killed::spawn(&mut command);
    let mut errors = BufReader::new(child.stderr.take().unwrap());
    let mut progress = String::new();
    while !progress.contains("number=1 count=6") {
        assert_ne!(errors.read_line(&mut progress).unwrap(), 0, "{progress}");
    }
    assert!(progress.contains("testing slaves=[0, 1] step=\"loopback, 125 kbit/s\""), "{progress}");
    kill_process(Pid::from_child(&child), Signal::INT).unwrap();
    let mut message = String::new();
    errors.read_to_string(&mut message).unwrap();
    let output = child.output();
    let printed = String::from_utf8(output.stdout).unwrap();
    assert_eq!(output.status.code(), Some(1), "{message}");
    assert!(message.contains("stopping after restoring the configuration\n"), "{message}");
    assert!(message.ends_with("\necan: stopped before the end of the test\n"), "{message}");
    let expected = "\
gateway 4294967297 at position 0: FAILED
  good    recognition    ECAN-Lite (0xF000)
  good    identity       vendor 0x00004543, product 0x4C495445, revision 0x00020002
  good    firmware       2.2.1
  good    serial number  4294967297
  good    configuration  as before the test, by a restart
  FAILED  test           stopped before the end
";
    let tail = expected.split_once("  good    configuration").unwrap();
    assert!(printed.starts_with(tail.0), "{printed}");
    assert_eq!(lines(&printed, "configuration").len(), 2, "{printed}");
    let restored = lines(&printed, "good    configuration");
    assert!(restored.iter().all(|line| line.ends_with("as before the test, by a restart")));
    for serial in ["4294967297", "4294967298"] {
        let report = json_of(&bus.read(&format!("reports/{serial}.json")));
        assert_eq!((&report["is_good"], &report["was_stopped"]), (&false.into(), &true.into()));
    }
}

#[test]
fn each_gateway_has_a_report() {
    let gateways = "firmware = [514, 1]\n[[gateway]]\nalias = 7\nfirmware = [514, 3]\n";
    let bus = Scenario::new(gateways);
    let (cell, reports) = (bus.write("cell.toml", CELL), bus.path("reports"));
    let options = ["selftest", "--config", &cell, "--report", &reports, "--gateways", "2"];
    let arguments = [&options[..], &["--expect-version", "2.2.1"]].concat();
    let printed = ends(1, &[&["--ecrt", &bus.setting()][..], &arguments].concat());
    let heads = lines(&printed, " at position ");
    let expected =
        ["gateway 4294967297 at position 0: passed", "gateway 4294967298 at position 1: FAILED"];
    assert_eq!(heads, expected);
    assert_eq!(lines(&printed, "FAILED  firmware").len(), 1, "{printed}");
    assert!(printed.contains("2.2.3, expected 2.2.1"), "{printed}");
    let report = |serial: &str| -> serde_json::Value {
        json_of(&bus.read(&format!("reports/{serial}.json")))
    };
    let (first, second) = (report("4294967297"), report("4294967298"));
    assert_eq!((&first["is_good"], &second["is_good"]), (&true.into(), &false.into()));
    assert_eq!((&first["firmware"], &second["firmware"]), (&"2.2.1".into(), &"2.2.3".into()));
    let frames = &first["checks"][4]["frames"];
    assert_eq!((&frames["sent"], &frames["received"]), (&96.into(), &96.into()));
    assert_eq!((&frames["bitrate"], &frames["data_bitrate"]), (&500_000.into(), &2_000_000.into()));
    assert_eq!(frames["channels"][0]["counters"]["transmit"], 0);
    // The same on standard output, and for one gateway.
    let json = json_of(&bus.good(&["--json", "--slave", "alias=7", "selftest", "--config", &cell]));
    assert_eq!(json["is_good"], true);
    assert_eq!(json["gateways"].as_array().map(Vec::len), Some(1));
    assert_eq!(json["gateways"][0]["serial"], 4_294_967_298_u64);
}

#[test]
fn duplicate_serial_number_fails() {
    let bus = scenario("[[gateway]]\nserial = 5\n[[gateway]]\nserial = 5\n");
    let printed = ends(1, &["--ecrt", &setting(&bus), "selftest", "--frames", "1"]);
    let failed = lines(&printed, "FAILED  serial number");
    assert_eq!(failed.len(), 1, "{printed}");
    assert!(
        failed.iter().all(|line| line.ends_with("5 is also the serial number of another gateway"))
    );
    let bus = scenario("[[gateway]]\nserial = 0\n");
    let printed = ends(1, &["--ecrt", &setting(&bus), "selftest", "--frames", "1"]);
    assert_eq!(lines(&printed, "not programmed").len(), 1, "{printed}");
}

#[test]
fn every_report_has_its_own_file() {
    let serials = [5, 5, 0, 0, u64::MAX].map(|serial| format!("[[gateway]]\nserial = {serial}\n"));
    let bus = Scenario::new("");
    bus.write("bus.toml", &serials.concat());
    let setting = bus.setting();
    let reports = bus.path("reports");
    let options = ["--frames", "1", "--channels", "0", "--report", &reports];
    let arguments = [&["--ecrt", &setting, "selftest"][..], &options].concat();
    let names = ["5", "5-position-1", "position-2", "position-3", "position-4"];
    for suffix in ["", "-2", "-3"] {
        let printed = ends(1, &arguments);
        let told = names.map(|name| format!("report: {reports}/{name}{suffix}.json"));
        assert_eq!(lines(&printed, "report: "), told);
        for (position, name) in names.iter().enumerate() {
            let text = bus.read(&format!("reports/{name}{suffix}.json"));
            let report = json_of(&text);
            assert_eq!(report["position"], position);
        }
    }
    let count = std::fs::read_dir(&reports).unwrap().count();
    assert_eq!(count, 15);
    let json = json_of(&ends(1, &[&["--json"], &arguments[..]].concat()));
    assert_eq!(json["gateways"][1]["file"], bus.path("reports/5-position-1-4.json"));
}

#[test]
fn unwritable_report_is_still_printed() {
    let output = ecan(&["--ecrt", "sim", "selftest", "--frames", "1", "--report", "/proc"]);
    let (printed, errors) = (String::from_utf8(output.stdout), String::from_utf8(output.stderr));
    assert_eq!(output.status.code(), Some(6));
    assert!(printed.unwrap().starts_with("gateway 4294967297 at position 0: passed\n"));
    assert!(errors.unwrap().contains("\necan: cannot write /proc/4294967297.json: "));
}

#[test]
fn invalid_use_is_reported() {
    let simulated = |status, arguments: &[&str]| {
        fails(status, &[&["--ecrt", "sim", "selftest"][..], arguments].concat())
    };
    assert_has(
        &simulated(2, &["--wired", "0-4"]),
        "expected pairs of channels 0 to 3, for example 0-1,2-3",
    );
    assert_has(&simulated(2, &["--wired", "0-1,1-2"]), "channel 1 is used twice");
    assert!(simulated(2, &["--frames", "0"]).contains("0 is not in 1..=256"));
    assert!(simulated(2, &["--channels", "5"]).contains("expected channels 0 to 3"));
    assert!(simulated(2, &["--pdo-n", "25"]).starts_with("ecan: "));
    let message = simulated(4, &["--gateways", "2"]);
    let expected = "ecan: expected 2 gateways, found 1; see `ecan scan`";
    assert_eq!(message, expected);
    let both = ["--ecrt", "sim", "--slave", "0", "selftest", "--gateways", "1"];
    assert!(fails(2, &both).contains("--gateways and --slave exclude each other"));
    let empty = scenario("[[gateway]]\nn = 5\n");
    let message = simulated(6, &["--config", &path(&empty)]);
    assert!(message.starts_with("ecan: cannot use "), "{message}");
    let report = format!("{}/reports", path(&empty));
    let message = simulated(6, &["--report", &report]);
    assert!(message.starts_with("ecan: cannot write "), "{message}");
    let message = simulated(6, &["--report", &path(&empty)]);
    assert!(message.ends_with(": not a directory"), "{message}");
    let reserved = scenario("reserved = true\n[[gateway]]\n");
    let message = fails(3, &["--ecrt", &setting(&reserved), "selftest"]);
    assert!(message.contains("another application has reserved it"), "{message}");
}

/// The number of the listening mode selects a loopback: the bus cannot be observed.
#[test]
fn channel_that_does_not_listen_gets_no_frame() {
    let nodes = "[[node]]\nkind = \"echo\"\nbus = \"0.0\"\n";
    let variant = "[gateway.variant]\nnode_modes = \"loopback_first\"\n";
    let bus = Scenario::new(&format!("{variant}{nodes}"));
    for (options, modes) in [
        (&[][..], "node mode 1 puts channel 0 into internal loopback, not into listen-only"),
        // The number of the internal loopback selects the external one: frames would disturb the bus.
        (
            &["--force"],
            "node mode 2 puts channel 0 into external loopback, not into internal loopback",
        ),
    ] {
        let arguments = ["selftest", "--frames", "8", "--channels", "0"];
        let output = bus.run(&[&arguments[..], options].concat());
        assert_eq!(output.status.code(), Some(1));
        let printed = String::from_utf8(output.stdout).unwrap();
        assert!(printed.contains(modes), "{printed}");
        assert!(printed.contains("(assumption H9"), "{printed}");
        assert_eq!(lines(&printed, "FAILED  ").len(), 1, "{printed}");
        assert!(printed.contains("as before the test"), "{printed}");
    }
}

/// Bus with a frame in each 50 ms for a minute, and a node that acknowledges.
fn busy(bus: &str, bitrate: u32) -> Scenario {
    let bitrate = format!("bitrate = {bitrate}\n");
    let scenario = Scenario::new(&format!(
        "[[node]]\nkind = \"replay\"\nbus = \"{bus}\"\nfile = \"bus.log\"\n{bitrate}\
         [[node]]\nkind = \"silent\"\nbus = \"{bus}\"\n{bitrate}"
    ));
    let frame = |at: u32| format!("({}.{:03}000) can0 181#1122\n", at / 20, at % 20 * 50);
    scenario.write("bus.log", &(0..1200).map(frame).collect::<String>());
    scenario
}

#[test]
fn bus_with_traffic_is_rejected_unless_forced() {
    let (bus, cell) = (busy("0.2", 500_000), cell());
    let cell = path(&cell);
    let output = bus.run(&["selftest", "--config", &cell]);
    let message = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(5), "{message}");
    assert_eq!(output.stdout, b"");
    let seen = "ecan: traffic on the bus within 1000 ms: channel 2 of slave 0: ";
    let (_, message) = message.split_once(seen).expect(&message);
    assert!(message.contains(" frames, the first with CAN ID 0x181; "), "{message}");
    assert!(message.ends_with("or test nevertheless with --force\n"), "{message}");
    // Other channels, and the forced test.
    let printed = bus.good(&["selftest", "--config", &cell, "--channels", "0,1,3"]);
    assert_eq!(lines(&printed, "96 frames, no errors").len(), 6, "{printed}");
    let printed = bus.good(&["selftest", "--config", &cell, "--force"]);
    assert_eq!(lines(&printed, "96 frames, no errors").len(), 8, "{printed}");
}

#[test]
fn traffic_with_another_bit_rate_is_rejected() {
    let (bus, cell) = (busy("0.1", 250_000), cell());
    let output = bus.run(&["selftest", "--config", &path(&cell)]);
    let message = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(5), "{message}");
    assert!(message.contains("channel 1 of slave 0: bus errors ("), "{message}");
    assert!(message.contains("as of traffic with another bit rate; "), "{message}");
}
