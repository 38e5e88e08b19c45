//! `ecan monitor`, printing once and on a terminal.

use std::process::Command;

use crate::support::terminal::{ENTER, LEAVE, OnTerminal};
use crate::support::{Scenario, all_fail, ecan, ends, good, json_of, scenario, setting, simulated};

#[test]
fn once_prints_gateways_channels_and_cycle() {
    let expected = "\
gateway  state  WC   incomplete  lost images  unknown  faulty images  lost  reason
0        ready  2/2  0           0            0        0              0

gateway 0
channel  state  load   frames/s  TEC  REC  rx/tx wait  dropped  bus-offs  received
can0     run    0.0 %  0.0       0    0    0/0         0        0         0
can1     run    0.0 %  0.0       0    0    0/0         0        0         0
can2     run    0.0 %  0.0       0    0    0/0         0        0         0
can3     run    0.0 %  0.0       0    0    0/0         0        0         0

";
    let shown = simulated(&["monitor", "--once", "--for", "2s"]);
    assert_eq!(shown.get(..expected.len()), Some(expected), "{shown}");
    let cycle = &shown[expected.len()..];
    // Simulated time keeps the cycle to the nanosecond.
    assert!(cycle.contains(" cycles, 0 overruns, 0 skipped\n"), "{cycle}");
    let period = "  period   1000.0 1000.0 1000.0 1000.0 1000.0 1000.0\n";
    assert!(cycle.contains(period), "{cycle}");
    assert!(cycle.ends_with(" s  gateway 0: ready\n"), "{cycle}");
}

#[test]
fn frames_have_rate_and_load() {
    // 100 frames a second of 111 bits at 500 kbit/s.
    let mut log = String::new();
    for at in 0..2000 {
        log.push_str(&format!(
            "({}.{:03}000) can0 123#1122334455667788\n",
            at / 100,
            at % 100 * 10
        ));
    }
    let bus = Scenario::replaying(&[], "");
    bus.write("bus.log", &log);
    let json = bus.good(&["monitor", "--for", "4s", "--json", "--channel", "0"]);
    let snapshot = json_of(&json);
    let channel = &snapshot["gateways"][0]["channels"][0];
    let rate = channel["rx_per_second"].as_f64().unwrap();
    assert!((99.0..101.0).contains(&rate), "{rate}");
    let load = channel["load"].as_f64().unwrap();
    assert!((load - rate * 111.0 / 500_000.0).abs() < 1e-6, "{load}");
    assert_eq!(channel["state"], "run");
    assert_eq!(snapshot["gateways"][0]["channels"][1]["state"], "disabled");
    assert_eq!(snapshot["gateways"][0]["state"], "ready");
    assert_eq!(snapshot["is_simulated"], true);
    assert!(snapshot["cycle"]["cycles"].as_u64().unwrap() > 4000);
}

/// Two gateways, and one that is switched off 9 s after the start.
fn losing(kind: &str) -> tempfile::NamedTempFile {
    scenario(&format!("[[gateway]]\n[[gateway]]\n[[fault]]\nat_ms = 6000\ngateway = 1\n{kind}\n"))
}

#[test]
fn power_cycled_gateway_is_lost_and_ready_again() {
    let file = losing("kind = \"power_cycle\"\noff_ms = 300");
    let shown = good(&["--ecrt", &setting(&file), "monitor", "--once", "--for", "9s"]);
    let rows: Vec<Vec<&str>> =
        shown.lines().map(|line| line.split_whitespace().collect()).collect();
    assert_eq!(rows[1], ["0", "ready", "2/2", "0", "0", "0", "0", "0"]);
    assert_eq!((&rows[2][..3], rows[2][7]), (&["1", "ready", "2/2"][..], "1"), "{shown}");
    assert_ne!(rows[2][5], "0", "the images before the power cycle are unknown");
    assert_ne!(rows[2][3], "0", "cycles without the gateway are incomplete");
    let events: Vec<_> = shown.lines().filter_map(|line| line.split_once(" s  ")).collect();
    let words: Vec<_> = events.iter().map(|(_, words)| *words).collect();
    let lost = "gateway 1: lost, waits for its process data to arrive";
    assert_eq!(words[..3], ["gateway 0: ready", "gateway 1: ready", lost]);
    assert!(words.last().unwrap().starts_with("gateway 1: ready after "), "{shown}");
}

#[test]
fn lost_gateway_sets_exit_status() {
    let file = losing("kind = \"power_off\"");
    let shown = ends(1, &["--ecrt", &setting(&file), "monitor", "--for", "9s"]);
    let rows: Vec<_> = shown.lines().collect();
    assert!(rows[1].starts_with("0        ready  2/2"), "{shown}");
    assert!(rows[2].starts_with("1        LOST   0/2"), "{shown}");
    assert!(rows[2].contains("  waiting for "), "{shown}");
    assert!(
        shown.contains(" s  gateway 1: lost, waits for its process data to arrive\n"),
        "{shown}"
    );
    let is_silent = |line: &&str| line.split_whitespace().filter(|word| *word == "-").count() == 8;
    let silent = shown.lines().filter(is_silent);
    assert_eq!(silent.count(), 4, "{shown}");
}

#[test]
fn short_bus_off_is_reported() {
    let fault = "[[fault]]\nat_ms = 7900\nkind = \"bus_off\"\ngateway = 0\nchannel = 1\n";
    let bus = Scenario::new(fault);
    let shown = bus.good(&["monitor", "--for", "7s"]);
    let (before, after) = shown.split_once("gateway 0 can1: bus-off\n").unwrap();
    assert!(after.ends_with(" s  gateway 0 can1: run\n"), "{shown}");
    let row = before.lines().find(|line| line.starts_with("can1")).unwrap();
    assert_eq!(row.split_whitespace().nth(9), Some("1"), "{row}");
}

#[test]
fn without_terminal_it_prints_once() {
    let output = ecan(&["--ecrt", "sim", "monitor"]);
    assert!(output.status.success());
    let errors = String::from_utf8(output.stderr).unwrap();
    let note = "standard output is not a terminal: printing once after 1 s, as with --once\n";
    assert!(errors.ends_with(note), "{errors}");
    assert_eq!(String::from_utf8(output.stdout).unwrap(), simulated(&["monitor", "--once"]));
}

#[test]
fn selected_gateway_is_monitored_alone() {
    let file = crate::support::two_gateways();
    let shown = good(&["--ecrt", &setting(&file), "--slave", "alias=7", "monitor", "--once"]);
    assert!(shown.contains("\ngateway 1\n") && !shown.contains("\ngateway 0\n"), "{shown}");
}

#[test]
fn invalid_use_has_message_and_status() {
    all_fail(&[
        (2, &["monitor", "--for", "5"], "a number without a unit is in milliseconds"),
        (2, &["monitor", "--for", "nan"], "expected a time"),
        (2, &["monitor", "--for", "-1"], "'-1'"),
        (2, &["monitor", "--channel", "4"], "expected channels 0 to 3"),
        (2, &["monitor", "extra"], "extra"),
        (
            2,
            &["--ecrt", "sim", "monitor", "--pdo-n", "25"],
            "N = 25 is out of range; allowed: 1 to 24",
        ),
        (2, &["--ecrt", "sim", "monitor", "--bitrate", "333"], "bit/s"),
    ]);
}

/// The monitor on a terminal.
fn on_terminal(library: &str) -> OnTerminal {
    let mut command = Command::new(env!("CARGO_BIN_EXE_ecan"));
    OnTerminal::start(command.args(["--ecrt", library, "monitor"]).env_remove("ECAN_ECRT"))
}

#[test]
fn terminal_is_drawn_until_quit_key_or_signal() {
    for key in [&b"q"[..], b"\x1b", b"\x03", b""] {
        let mut monitor = on_terminal("sim");
        monitor.wait_for(ENTER);
        monitor.wait_for("Channels");
        monitor.wait_for("Cycle");
        assert!(monitor.is_raw());
        monitor.press(b"p?");
        monitor.wait_for("PAUSED");
        monitor.wait_for("close");
        monitor.press(b"?p");
        if key.is_empty() {
            monitor.terminate();
        }
        monitor.press(key);
        assert_eq!(monitor.end().0, Some(0), "{key:?}");
    }
}

#[test]
fn failed_bus_restores_terminal_and_prints_message() {
    let fault = "[[fault]]\nat_ms = 3000\nkind = \"library_error\"\ncall = \"send\"\n\
                 errno = \"EIO\"\ntimes = 1000000\n";
    let file = scenario(&format!("[[gateway]]\n{fault}"));
    let mut monitor = on_terminal(&setting(&file));
    monitor.wait_for("Channels");
    monitor.wait_for(LEAVE);
    let (status, said) = monitor.end();
    assert_eq!(status, Some(3));
    // The message comes behind the screen, not on it.
    assert!(said.contains("ecan: "), "{said}");
}
