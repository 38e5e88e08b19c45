//! `--config` of the commands that carry frames, and of `monitor`.

use crate::support::client::Client;
use crate::support::{Scenario, assert_has, fails, json_of};

/// Channels 0 and 2; standard frames other than 100 to 1FF stay out, extended ones all.
const CELL: &str = "\
cycle_us = 1000
[[gateway]]
n = 4
[gateway.can0]
bitrate = 250_000
non_match_standard = 'reject'
non_match_extended = 'reject'
[[gateway.can0.standard_filter]]
match = 'range'
action = 'fifo0'
id1 = 0x100
id2 = 0x1FF
[gateway.can2]
bitrate = 125_000
data_bitrate = 1_000_000
";

const FRAMES: [(u64, &str); 4] =
    [(0, "0FF#01"), (100, "123#02"), (200, "200#03"), (300, "00000123#04")];

/// A gateway whose can0 has a bit rate in kbit/s, with a node that sends frames there.
fn bus(kilobit: u32, frames: &[(u64, &str)]) -> Scenario {
    let bus = Scenario::replaying(frames, "");
    let rate = format!("bus = \"0.0\"\nbitrate = {kilobit}000\n");
    bus.write("bus.toml", &bus.read("bus.toml").replace("bus = \"0.0\"\n", &rate));
    bus.write("cell.toml", CELL);
    bus
}

#[test]
fn file_sets_bit_rates_and_filters() {
    let bus = bus(250, &FRAMES);
    let path = bus.path("cell.toml");
    let everything = "  can0  0FF   [1]  01\n  can0  123   [1]  02\n  can0  200   [1]  03\n";
    let options = ["dump", "--bitrate", "250000", "-n", "3"];
    assert_eq!(bus.good(&options), everything);
    let output = bus.run(&["dump", "--config", &path, "-T", "9000", "-n", "2"]);
    assert_eq!(output.status.code(), Some(1));
    assert_eq!(String::from_utf8(output.stdout).unwrap(), "  can0  123   [1]  02\n");
    // At another bit rate nothing is understood.
    let wrong = bus.write("wrong.toml", &CELL.replace("250_000", "500_000"));
    let output = bus.run(&["dump", "--config", &wrong, "-T", "9000"]);
    assert_eq!((output.status.code(), output.stdout.len()), (Some(1), 0));
}

#[test]
fn frames_are_sent_at_file_bit_rates() {
    let bus = bus(250, &[]);
    let path = bus.path("cell.toml");
    assert_eq!(bus.good(&["send", "--config", &path, "700#01"]), "can0 700#01 sent\n");
    let shown = bus.good(&["gen", "--config", &path, "-n", "20", "-g", "1"]);
    assert!(shown.starts_with("20 frames sent, 0 lost, "), "{shown}");
    let log = bus.write("drive.log", "(1.000000) can0 123#01\n(1.010000) can0 124#02\n");
    let shown = bus.good(&["replay", &log, "--config", &path, "--channel", "all"]);
    assert!(shown.starts_with("2 frames sent, 0 lost, "), "{shown}");
    // At another bit rate nobody acknowledges; the message names the file's.
    let wrong = bus.write("wrong.toml", &CELL.replace("250_000", "500_000"));
    let arguments = ["send", "--config", &wrong, "700#01", "--timeout", "300"];
    assert_has(&bus.fails(1, &arguments), "at 500000 bit/s");
}

#[test]
fn can_fd_needs_data_bit_rate_in_file() {
    let bus = Scenario::new("[[node]]\nkind = \"echo\"\nbus = \"0.2\"\n");
    let path = bus.write("cell.toml", CELL);
    let fd = ["--config", &path, "123##1AA"];
    assert_eq!(bus.good(&[&["send", "--channel", "2"][..], &fd].concat()), "can2 123##1AA sent\n");
    let gen_fd = ["gen", "-b", "-n", "5", "--config", &path, "--channel"];
    assert!(bus.good(&[&gen_fd[..], &["2"]].concat()).starts_with("5 frames sent, 0 lost"));

    let none = format!("channel 0 has no data_bitrate in {path}");
    let message = bus.fails(2, &[&["send"][..], &fd].concat());
    assert_eq!(message, format!("ecan: 123##1AA is a CAN FD frame: {none}"));
    let message = bus.fails(2, &[&gen_fd[..], &["0"]].concat());
    assert_eq!(message, format!("ecan: CAN FD frames are requested: {none}"));
    let log = bus.write("fd.log", "(1.000000) can0 1FF##1AA\n");
    let message = bus.fails(2, &["replay", &log, "--config", &path]);
    assert_eq!(message, format!("ecan: {log}, line 1 is a CAN FD frame: {none}"));
}

#[test]
fn bridge_uses_file_bit_rates() {
    let bus = Scenario::new("[[node]]\nkind = \"echo\"\nbus = \"0.2\"\n");
    let path = bus.write("cell.toml", CELL);
    let mut bridge = bus.start(&["bridge", "--config", &path, "--channel", "2"]);
    let line = bridge.line();
    let talk = |say: &str, expected: &str| {
        let mut client = Client::connect(line.split(' ').nth(3).unwrap());
        client.say(say);
        client.expect(expected);
    };
    // S4 is 125 kbit/s, S6 500; Y1 1 Mbit/s of data.
    talk("S4\rY1\rO\rb12308AA\r", "\r\r\r");
    talk("S6\rO\rt1230\r", "\x07\x07\x07");
    talk("S4\rO\rt1232AABB\r", "\r\rz\rt1232AABB\r");
    bridge.end();
}

#[test]
fn monitor_shows_channels_of_the_file() {
    let frames: Vec<_> = (0..300).map(|at| (at * 10, "123#1122334455667788")).collect();
    let bus = bus(250, &frames);
    let path = bus.path("cell.toml");
    let json = bus.good(&["monitor", "--config", &path, "--for", "10s", "--json"]);
    let snapshot = json_of(&json);
    let channels = &snapshot["gateways"][0]["channels"];
    let states: Vec<_> = (0..4).map(|at| channels[at]["state"].as_str().unwrap()).collect();
    assert_eq!(states, ["run", "disabled", "run", "disabled"]);
    let rate = channels[0]["rx_per_second"].as_f64().unwrap();
    let load = channels[0]["load"].as_f64().unwrap();
    assert!(rate > 20.0 && (load - rate * 111.0 / 250_000.0).abs() < 1e-6, "{rate} {load}");
}

const TWO: &str = "\
[[gateway]]
n = 2
[gateway.can0]
bitrate = 500_000
[[gateway]]
alias = 7
n = 3
[gateway.can1]
bitrate = 500_000
";

#[test]
fn slave_must_be_in_the_file() {
    let second = "[[gateway]]\nalias = 7\n[[gateway]]\n[[node]]\nkind = \"echo\"\nbus = \"1.1\"\n";
    let bus = Scenario::new(second);
    let (two, one) = (bus.write("two.toml", TWO), bus.path("one.toml"));
    let send = |file, channel, rest: &[&str]| -> Vec<String> {
        let arguments = ["send", "123#", "--config", file, "--channel", channel];
        arguments.iter().chain(rest).map(|arguments| (*arguments).to_owned()).collect()
    };
    let run = |arguments: &[String]| {
        let arguments: Vec<_> = arguments.iter().map(String::as_str).collect();
        let output = bus.run(&arguments);
        let texts = [output.stdout, output.stderr].map(|bytes| String::from_utf8(bytes).unwrap());
        (output.status.code().unwrap(), texts.concat().replace("SIMULATED", "\nSIMULATED"))
    };
    let check = |arguments: Vec<String>, status: i32, words: &str| {
        let (found, text) = run(&arguments);
        assert!(found == status && text.contains(words), "{arguments:?}: {found} {text}");
    };
    let several = format!("{two} describes several gateways; select one with --slave: 0, 1\n");
    check(send(&two, "1", &[]), 4, &several);
    check(send(&two, "1", &["--slave", "alias=7"]), 0, "can1 123# sent\n");
    check(send(&two, "1", &["--slave", "1"]), 0, "can1 123# sent\n");
    check(send(&two, "1", &["--slave", "2"]), 4, "slave 2 is not a gateway of the file\n");
    check(send(&two, "1", &["--slave", "3"]), 4, "slave 3 does not exist");
    // A channel that the file does not have, by name.
    let missing = format!("channel 2 is not in {two}; gateway 1 has channel 1\n");
    check(send(&two, "2", &["--slave", "1"]), 2, &missing);
    let missing = format!("channel 1 is not in {two}; gateway 0 has channel 0\n");
    check(send(&two, "1", &["--slave", "0"]), 2, &missing);
    // With one gateway in the file there is no question, whatever else is on the bus.
    let second_alone = &TWO[TWO.rfind("[[gateway]]").unwrap()..];
    std::fs::write(&one, second_alone).unwrap();
    check(send(&one, "1", &[]), 0, "can1 123# sent\n");
    let nobody = bus.write("nobody.toml", &second_alone.replace("alias = 7", "alias = 9"));
    check(send(&nobody, "1", &[]), 4, "no slave has the alias 9\n");
    let empty = bus.write("empty.toml", "cycle_us = 1000\n");
    check(send(&empty, "1", &[]), 6, "no slave is configured\n");

    let shown = bus.good(&["monitor", "--once", "--config", &two]);
    assert!(shown.contains("\ngateway 0\n") && shown.contains("\ngateway 1\n"), "{shown}");
    assert!(!shown.contains("\ngateway 2\n"), "{shown}");
}

#[test]
fn channels_missing_in_file_are_rejected() {
    let bus = bus(250, &FRAMES);
    let path = bus.path("cell.toml");
    let log = bus.write("drive.log", "(1.000000) can0 123#01\n(1.000000) can3 124#02\n");
    let has = format!("is not in {path}; gateway 0 has channels 0, 2");
    let cases: [(&str, &[&str]); 5] = [
        ("1", &["dump", "--channel", "0,1"]),
        ("1", &["dump", "--channel", "0,1,2,3"]),
        ("3", &["gen", "-n", "1", "--channel", "3"]),
        ("3", &["replay", &log, "--channel", "all"]),
        ("1", &["bridge", "--channel", "1"]),
    ];
    for (channel, arguments) in cases {
        let message = bus.fails(2, &[arguments, &["--config", &path]].concat());
        assert_eq!(message, format!("ecan: channel {channel} {has}"), "{arguments:?}");
    }
    // All means all that there are; a channel that is not named stays out of sight.
    assert!(bus.good(&["dump", "-n", "1", "--config", &path]).starts_with("  can0  123 "));
    let arguments = ["dump", "--channel", "2", "-T", "9000", "--config", &path];
    let words = "ecan: no frame received; check that the other nodes use 125000/1000000 bit/s";
    assert_eq!(bus.fails(1, &arguments), words);
}

#[test]
fn invalid_file_is_rejected_with_all_faults() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("cell.toml").display().to_string();
    let text = CELL.replace("n = 4", "n = 40").replace("125_000", "333").replace("0x100", "0x800");
    std::fs::write(&path, text).unwrap();
    let commands: [&[&str]; 5] =
        [&["dump"], &["send", "001#"], &["gen"], &["bridge"], &["monitor", "--once"]];
    for command in commands {
        let arguments = [&["--ecrt", "sim"], command, &["--config", &path]].concat();
        let message = fails(6, &arguments);
        assert!(message.starts_with(&format!("ecan: cannot use {path}: 3 faults")), "{message}");
        assert!(message.contains("line 3, column 5: `n` = 40"), "{message}");
        assert!(message.contains("line 11, column 7: `id1` = 2048"), "{message}");
    }
}

#[test]
fn options_defined_by_file_are_rejected() {
    let flags: [&[&str]; 7] = [
        &["--bitrate", "500000"],
        &["--data-bitrate", "2000000"],
        &["--sample-point", "80"],
        &["--data-sample-point", "80", "--data-bitrate", "2000000"],
        &["--pdo-n", "5"],
        &["--large-pdos"],
        &["--cycle-us", "1000"],
    ];
    let commands: [&[&str]; 6] =
        [&["dump"], &["send", "001#"], &["gen"], &["replay", "x.log"], &["bridge"], &["monitor"]];
    for flag in flags {
        for command in commands {
            let message = fails(2, &[command, &["--config", "cell.toml"], flag].concat());
            assert!(message.contains("'--config <FILE>' cannot be used with"), "{message}");
            assert!(message.contains(flag[0]), "{message}");
        }
    }
    let message = fails(2, &["monitor", "--config", "cell.toml", "--channel", "1"]);
    assert!(message.contains("cannot be used with") && message.contains("--channel"), "{message}");
}

#[test]
fn listen_only_and_device_time_work_with_file() {
    let bus = bus(250, &FRAMES);
    let path = bus.path("cell.toml");
    let shown = bus.good(&["dump", "-n", "1", "-H", "--listen-only", "--config", &path]);
    let (columns, time) = shown.trim_end().rsplit_once("  +").unwrap();
    assert_eq!(columns, "  can0  123   [1]  02");
    assert!(time.parse::<u16>().is_ok());
}

/// A Sync0 pulse among the arrivals of the outputs, by the plan: the simulated machine sends at once.
#[test]
fn shift_among_the_arrivals_is_a_warning() {
    let bus = bus(250, &[]);
    let with_shift = |us| {
        let dc = format!("cycle_us = 1000\n[dc]\nshift_us = {us}\n");
        bus.write("cell.toml", &CELL.replace("cycle_us = 1000\n", &dc))
    };
    let warning = "warning: Sync0 190.0 us after the start of the cycle falls into the arrival";
    for (shift_us, is_warned) in [(190, true), (700, false)] {
        let path = with_shift(shift_us);
        let commands =
            [&["send", "--config", &path, "700#01"][..], &["monitor", "--once", "--config", &path]];
        for command in commands {
            let output = bus.run(command);
            let errors = String::from_utf8(output.stderr).unwrap();
            assert_eq!(output.status.code(), Some(0), "{errors}");
            assert_eq!(errors.contains(warning), is_warned, "{command:?}: {errors}");
        }
        let checked = bus.run(&["config", "check", &path]);
        let printed = String::from_utf8(checked.stdout).unwrap();
        assert_eq!((checked.status.code(), printed.contains(warning)), (Some(0), is_warned));
    }
}

#[test]
fn channel_of_one_direction_is_rejected_for_the_other() {
    let bus = bus(250, &FRAMES);
    let masks = "n = 4\ntx_pdo = { channels = ['can0'] }\nrx_pdo = { channels = ['can2'] }";
    let path = bus.write("masks.toml", &CELL.replace("n = 4", masks));
    let shown = bus.good(&["config", "check", &path]);
    assert!(shown.contains("CAN0   classic CAN, receives only\n"), "{shown}");
    assert!(shown.contains("CAN2   CAN FD, delay compensation on, sends only\n"), "{shown}");
    for command in [vec!["send", "123#01"], vec!["gen", "-n", "1"]] {
        let options =
            [&command[..1], &["--config", &path, "--channel", "0"], &command[1..]].concat();
        let message = fails_on(&bus, &options);
        assert!(message.contains("channel 0 of gateway 0 only receives in "), "{message}");
        assert!(message.contains("not among the `channels` of the RxPDO"), "{message}");
    }
    let message = fails_on(&bus, &["dump", "--config", &path, "--channel", "can2"]);
    assert!(message.contains("channel 2 of gateway 0 only sends in "), "{message}");
    let output = bus.run(&["send", "--config", &path, "--channel", "2", "700#01"]);
    let message = String::from_utf8(output.stderr).unwrap();
    assert!(message.contains("channel 2 only sends") && message.contains("H45"), "{message}");
    let output = bus.run(&["dump", "--config", &path, "-T", "9000", "-n", "1"]);
    assert_eq!(String::from_utf8(output.stdout).unwrap(), "  can0  123   [1]  02\n");
    let plan = bus.good(&["plan", "--config", &path, "--frames", "1", "--bytes", "0"]);
    assert!(!plan.contains("only"), "{plan}");
}

/// Standard error of a command that is used wrongly.
fn fails_on(bus: &Scenario, options: &[&str]) -> String {
    let output = bus.run(options);
    assert_eq!(output.status.code(), Some(2), "{options:?}");
    String::from_utf8(output.stderr).unwrap()
}
