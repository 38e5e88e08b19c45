//! `simple_loop` as a user runs it.

use std::path::Path;
use std::process::{Command, Output};

use crate::program::{self, contains_all, master_faults, text, written};
use ecan_can_io::candump::Record;
use ecan_example_support::summary::BusLoad;
use ecan_protocol::can::{CanFrame, CanId, Dlc};
use ecan_test_support::output;

fn command(arguments: &[&str]) -> Command {
    program::command("simple_loop", arguments)
}

fn succeeds(arguments: &[&str]) -> String {
    program::succeeds("simple_loop", arguments)
}

fn fails(arguments: &[&str]) -> String {
    program::fails("simple_loop", arguments)
}

fn frames_of_log(path: &Path) -> Vec<CanFrame> {
    let log = std::fs::read_to_string(path).unwrap();
    log.lines().map(|line| ecan_can_io::candump::parse_line(line).unwrap().unwrap().frame).collect()
}

#[test]
fn plain_loop_runs_and_prints_a_summary() {
    let printed = succeeds(&["--ecrt", "sim"]);
    assert!(printed.starts_with("SIMULATED"), "{printed}");
    let channel = printed.lines().find(|line| line.starts_with("slave 0 can0")).unwrap();
    let numbers: Vec<_> = channel.split_whitespace().skip(3).take(9).collect();
    let (sent, received) = (["1000", "1000", "0", "0", "0", "0"], ["1000", "0", "0"]);
    assert_eq!(numbers, [&sent[..], &received].concat(), "{printed}");
}

#[test]
fn three_gateways_with_all_channels_run_at_1_ms() {
    let arguments = ["--ecrt", "sim", "--slaves", "3", "--channel", "all", "--cycle-us", "1000"];
    let printed = succeeds(&[&arguments[..], &["--cycles", "200"]].concat());
    assert_eq!(printed.matches("can").count(), 12, "{printed}");
    let gateway = printed.lines().filter(|line| line.ends_with("0         0"));
    assert_eq!(gateway.count(), 3, "no loss, no error: {printed}");
}

/// `ecan scan` has the same test, with the same faults and texts.
#[test]
fn faults_of_the_master_are_named_as_by_scan() {
    let sources = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../ecrt-sys"));
    master_faults::check_reports(sources, || command(&["--cycles", "10"]));
}

#[test]
fn option_ecrt_takes_precedence_over_the_environment() {
    let output = output(command(&["--cycles", "10"]).env("ECAN_ECRT", "sim"));
    assert!(output.status.success(), "{}", text(&output.stderr));
    let output = command(&["--ecrt", "/no/such/libethercat.so", "--cycles", "10"])
        .env("ECAN_ECRT", "sim")
        .output()
        .unwrap();
    assert!(!output.status.success(), "the option wins");
}

#[test]
fn option_log_prints_events_on_standard_error() {
    let arguments = ["--ecrt", "sim", "--cycles", "10", "--log", "ecan_mcan_port=info"];
    let output = program::run("simple_loop", &arguments);
    assert!(output.status.success() && text(&output.stderr).contains("ecan_mcan_port"));
    assert!(!text(&output.stdout).contains("ecan_mcan_port"));
}

#[test]
fn same_seed_gives_same_output() {
    let arguments = ["--ecrt", "sim", "--seed", "7", "--cycles", "300", "--channel", "all"];
    assert_eq!(succeeds(&arguments), succeeds(&arguments));
}

#[test]
fn wrong_scenario_or_file_returns_status_6() {
    let (_directory, wrong) = written("[[gateway]]\nn = 30\n");
    let scenario = format!("sim:{wrong}");
    let cases: [(i32, &str, &[&str]); 8] = [
        (6, "simple_loop", &["--ecrt", "sim:/no/such.toml"]),
        (6, "simple_loop", &["--ecrt", &scenario]),
        (6, "simple_loop", &["--ecrt", "sim", "--config", &wrong]),
        (6, "simple_loop", &["--ecrt", "sim", "--replay", "/no/such.log"]),
        (6, "canopen_network", &["--ecrt", "sim", "/no/such.toml"]),
        (6, "cia402_single_axis_demo", &["--ecrt", "sim:ecco"]),
        (3, "canopen_sdo_probe", &["--ecrt", "/no/such.so", "--node", "1", "--index", "0x1000"]),
        (1, "canopen_sdo_probe", &["--ecrt", "sim", "--node", "77", "--index", "0x1000"]),
    ];
    for (status, name, arguments) in cases {
        let output = program::run(name, arguments);
        let message = text(&output.stderr);
        assert_eq!(output.status.code(), Some(status), "{name} {arguments:?}: {message}");
    }
}

#[test]
fn missing_master_error_names_cause_and_remedy() {
    let message = fails(&["--ecrt", "/no/such/libethercat.so.1"]);
    assert!(message.contains("/no/such/libethercat.so.1 was not found"), "{message}");
    assert_eq!(message.trim().lines().count(), 1, "{message}");
    // Where IgH is installed the message is about its master instead.
    let message = fails(&[]);
    assert!(message.contains("EtherCAT"), "{message}");
    let missing = message.contains("libethercat.so.1 was not found");
    assert!(!missing || message.contains("install the IgH EtherCAT master"), "{message}");
    assert!(!missing || message.contains("simulated"), "{message}");
}

#[test]
fn real_recording_returns_unchanged() {
    let log = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/data/vehicle-can.log");
    if !log.exists() {
        println!("skipped: {} is not there", log.display());
        return;
    }
    let directory = tempfile::tempdir().unwrap();
    let back = directory.path().join("back.log");
    let (log, dump) = (log.to_str().unwrap(), back.to_str().unwrap());
    let printed = succeeds(&["--ecrt", "sim", "--replay", log, "--dump", dump]);
    assert!(printed.contains("6158 frames sent, 6158 returned"), "{printed}");
    assert_eq!(frames_of_log(&back), frames_of_log(Path::new(log)));
}

/// Every DLC of every kind of frame, with 11 and 29 bit identifiers.
fn all_kinds() -> Vec<CanFrame> {
    let mut frames = Vec::new();
    for n in 0..64_u16 {
        let standard = CanId::standard(0x100 + n).unwrap();
        let extended = CanId::extended(0x1234_0000 + u32::from(n)).unwrap();
        for id in [standard, extended] {
            let dlc = Dlc::new((n % 16) as u8).unwrap();
            let data = [n as u8; 64];
            frames.push(CanFrame::fd(id, &data[..dlc.fd_len()], n % 2 == 0, false).unwrap());
            if dlc.value() <= 8 {
                frames.push(CanFrame::classic(id, &data[..dlc.classic_len()]).unwrap());
                frames.push(CanFrame::remote(id, dlc).unwrap());
            }
        }
    }
    frames
}

fn write_log(path: &Path, frames: &[CanFrame], interface: &str, spacing_ns: u64) {
    let line = |(nth, frame): (usize, &CanFrame)| {
        // Microseconds and nanoseconds, with and without a direction mark.
        let time_ns = 1_700_000_000_000_000_000 + nth as u64 * spacing_ns + (nth as u64 % 3) * 7;
        let direction = (nth % 2 == 1).then_some(ecan_can_io::candump::DirectionMark::Received);
        format!("{}\n", Record { time_ns, interface, frame: *frame, direction })
    };
    let log: String = frames.iter().enumerate().map(line).collect();
    std::fs::write(path, log).unwrap();
}

#[test]
fn every_kind_of_frame_is_replayed() {
    let directory = tempfile::tempdir().unwrap();
    let (log, back) = (directory.path().join("all.log"), directory.path().join("back.log"));
    let frames = all_kinds();
    write_log(&log, &frames, "can2", 50_000);
    let (log_name, dump) = (log.to_str().unwrap(), back.to_str().unwrap());
    let base = ["--ecrt", "sim", "--replay", log_name, "--dump", dump];
    for extra in [&["--cycle-us", "1000", "--pdo-n", "8"][..], &["--channel", "all"][..]] {
        let arguments = [&base[..], &["--fd", "2000000"][..], extra].concat();
        let printed = succeeds(&arguments);
        assert!(printed.contains("unchanged and in order"), "{printed}");
        assert_eq!(frames_of_log(&back), frames);
    }
    let message = fails(&base);
    assert!(
        message.contains("line 1: CAN FD frame, but slave 0 channel 0 is classic; set --fd"),
        "{message}"
    );
}

#[test]
fn replay_with_lost_frames_fails() {
    let directory = tempfile::tempdir().unwrap();
    let log = directory.path().join("drive.log");
    let id = CanId::standard(1).unwrap();
    let frames: Vec<_> = (0..200_u8).map(|n| CanFrame::classic(id, &[n]).unwrap()).collect();
    write_log(&log, &frames, "can0", 50_000);
    let toml = "[[gateway]]\n\n[[node]]\nname = \"lossy\"\nbus = \"0.0\"\nkind = \"faulty\"\n\
                drop_permille = 100\n";
    let (_scenario, scenario) = written(toml);
    let ecrt = format!("sim:{scenario}");
    let message = fails(&["--ecrt", &ecrt, "--replay", log.to_str().unwrap()]);
    assert!(message.contains("did not return") || message.contains("expected"), "{message}");
}

#[test]
fn stalled_replay_ends_with_the_reason() {
    let directory = tempfile::tempdir().unwrap();
    let log = directory.path().join("drive.log");
    let id = CanId::standard(1).unwrap();
    let frames: Vec<_> = (0..200_u8).map(|n| CanFrame::classic(id, &[n]).unwrap()).collect();
    write_log(&log, &frames, "can0", 200_000_000);
    let alone = "[[gateway]]\n";
    let dies = "[[gateway]]\n[[node]]\nkind = \"echo\"\nbus = \"0.0\"\n\
                [[fault]]\nkind = \"power_off\"\ngateway = 0\ncycle = 30000\n";
    for (toml, expected) in [(alone, "were not sent"), (dies, "waiting for OP")] {
        let (_scenario, scenario) = written(toml);
        let ecrt = format!("sim:{scenario}");
        let arguments = ["--ecrt", &ecrt, "--cycle-us", "1000", "--replay", log.to_str().unwrap()];
        let message = fails(&arguments);
        assert!(message.contains(expected), "{message}");
    }
}

#[test]
fn recording_is_not_overwritten() {
    let directory = tempfile::tempdir().unwrap();
    let log = directory.path().join("drive.log");
    let frame = CanFrame::classic(CanId::standard(1).unwrap(), &[1]).unwrap();
    write_log(&log, &[frame], "can0", 50_000);
    let name = log.to_str().unwrap();
    let message = fails(&["--ecrt", "sim", "--replay", name, "--dump", name]);
    assert!(message.contains("would overwrite"), "{message}");
    assert_eq!(frames_of_log(&log), [frame]);
}

#[test]
fn wrong_use_returns_a_helpful_message() {
    let (_bad, bad) = written("# nothing\n(1.000000) can0 12Z#00\n");
    let (_empty, empty) = written("# nothing\n\n");
    let cases: &[(&[&str], &str)] = &[
        (&["--slaves", "0"], "--slaves"),
        (&["--channel", "4"], "0 to 3 or `all`"),
        (&["--cycles", "many"], "--cycles"),
        (&["--no-such-flag"], "--no-such-flag"),
        (&["--replay", "/no/such.log"], "cannot read /no/such.log"),
        (&["--replay", &bad], "line 2, column"),
        (&["--replay", &empty], "holds no frame"),
        (&["--dump", "/no/such/dir/out.log"], "cannot write /no/such/dir/out.log"),
        (&["--pdo-n", "0"], "allowed: 1 to 24"),
        (&["--pdo-n", "12"], "at most 11"),
        (&["--bitrate", "3M"], "bit timing"),
        (&["--cycle-us", "10"], "cycle of 10 us"),
    ];
    program::all_fail("simple_loop", &["--ecrt", "sim"], cases);
    program::all_fail("simple_loop", &[], &[(&["--ecrt", "sim:none"], "unknown scenario")]);
}

/// Two gateways with a place between them: CAN FD and classic CAN on the first, classic CAN on the
/// second.
const CELL: &str = "\
cycle_us = 2000
[dc]
shift_us = 500
[[gateway]]
n = 5
can0 = { bitrate = 500_000, data_bitrate = 2_000_000 }
can2 = { bitrate = 250_000 }
[[gateway]]
position = 2
n = 3
can1 = { bitrate = 1_000_000 }
";

/// The channels of the summary: name, frames accepted and delivered, bus load.
fn channels(printed: &str) -> Vec<(String, u64, u64, f64)> {
    let lines = printed.lines().filter(|line| line.starts_with("slave ") && line.contains(" can"));
    let row = |line: &str| {
        let expected: Vec<_> = line.split_whitespace().collect();
        let number = |at: usize| expected[at].parse::<u64>().unwrap();
        (expected[1..3].join(" "), number(3), number(4), expected[12].parse().unwrap())
    };
    lines.map(row).collect()
}

/// Interface and frame of every line.
fn lines_of_log(path: &Path) -> Vec<(String, CanFrame)> {
    let log = std::fs::read_to_string(path).unwrap();
    let line = |line| {
        let Record { interface, frame, .. } =
            ecan_can_io::candump::parse_line(line).unwrap().unwrap();
        (interface.to_owned(), frame)
    };
    log.lines().map(line).collect()
}

#[test]
fn configuration_file_sets_channels_and_bit_rates() {
    let directory = tempfile::tempdir().unwrap();
    let (cell, back) = (directory.path().join("cell.toml"), directory.path().join("back.log"));
    std::fs::write(&cell, CELL).unwrap();
    let (config, dump) = (cell.to_str().unwrap(), back.to_str().unwrap());
    let base = ["--ecrt", "sim", "--cycles", "200", "--config", config, "--dump", dump];

    let printed = succeeds(&base);
    assert!(printed.contains("2 gateway(s) ready"), "{printed}");
    assert!(printed.contains(" s, cycle 2000 us\n"), "{printed}");
    let rows = channels(&printed);
    let names: Vec<_> = rows.iter().map(|row| row.0.as_str()).collect();
    assert_eq!(names, ["0 can0", "0 can2", "1 can1"], "{printed}");
    assert!(rows.iter().all(|row| (row.1, row.2) == (200, 200)), "{printed}");
    let returned = lines_of_log(&back);
    for (interface, is_fd, length) in [("can0", true, 64), ("can2", false, 8), ("can5", false, 8)] {
        let of_interface = || returned.iter().filter(|frame| frame.0 == interface);
        let is_right = |frame: &CanFrame| frame.as_ref().is_fd() == is_fd && frame.len() == length;
        assert!(of_interface().all(|frame| is_right(&frame.1)), "{interface}");
        assert_eq!(of_interface().count(), 200, "{interface}");
    }
    assert_eq!(returned.len(), 600);
    // Each bus has its own rates: the load of one gives those of the others.
    let percent = |interface: &str, nominal, data| {
        let mut load = BusLoad::default();
        load.add(&returned.iter().find(|frame| frame.0 == interface).unwrap().1);
        load.percent(nominal, data, 1_000_000)
    };
    let reference = rows[2].3 / percent("can5", 1_000_000, 1);
    let others = [percent("can0", 500_000, 2_000_000), percent("can2", 250_000, 1)];
    for (row, percent) in rows.iter().zip(others) {
        let expected = percent * reference;
        assert!((row.3 / expected - 1.0).abs() < 0.01, "{expected}: {printed}");
    }

    // Frames of one channel only; the others stay ready.
    let printed = succeeds(&[&base[..], &["--channel", "1"]].concat());
    let sent: Vec<_> = channels(&printed).iter().map(|row| row.1).collect();
    assert_eq!(sent, [0, 0, 200], "{printed}");
    let all = succeeds(&[&base[..], &["--channel", "all"]].concat());
    assert_eq!(channels(&all), rows);
    let message = fails(&[&base[..], &["--channel", "3"]].concat());
    assert_eq!(message, format!("simple_loop: {config} has no channel 3\n"));
}

#[test]
fn recording_uses_channels_of_the_configuration_file() {
    let directory = tempfile::tempdir().unwrap();
    let path = |name: &str| directory.path().join(name);
    let (cell, log, back) = (path("cell.toml"), path("drive.log"), path("back.log"));
    std::fs::write(&cell, CELL).unwrap();
    let [config, replay, dump] = [&cell, &log, &back].map(|path| path.to_str().unwrap());
    let base = ["--ecrt", "sim", "--config", config, "--replay", replay, "--dump", dump];
    let write = |lines: &[&str]| {
        let line = |(nth, frame): (usize, &&str)| format!("({nth}.000000) {frame}\n");
        std::fs::write(&log, lines.iter().enumerate().map(line).collect::<String>()).unwrap();
    };

    write(&["can0 123##1112233", "can2 124#11", "can5 125#22", "can0 126#33"]);
    let printed = succeeds(&base);
    assert!(printed.contains("4 frames sent, 4 returned"), "{printed}");
    assert_eq!(lines_of_log(&back), lines_of_log(&log));
    let printed = succeeds(&[&base[..], &["--plan"]].concat());
    let channels = ["slave 0 can0", "slave 0 can2", "slave 1 can1"];
    contains_all(&printed, &[&channels[..], &["plan for 2 gateway(s), cycle 2000.0 us"]].concat());
    // With --channel all frames go to the first gateway that has it, for any interface.
    write(&["can0 124#11", "can7 125#22"]);
    succeeds(&[&base[..], &["--channel", "1"]].concat());
    let returned = lines_of_log(&back);
    assert_eq!(returned.len(), 2);
    assert!(returned.iter().all(|frame| frame.0 == "can5"), "{returned:?}");

    let elsewhere = "line 2: can6 is slave 1 channel 2, which is not configured";
    let classic = "line 2: CAN FD frame, but slave 0 channel 2 is classic; set data_bitrate in";
    for (line, expected) in [("can6 001#", elsewhere), ("can2 001##100", classic)] {
        write(&["can0 123##1112233", line]);
        for plan in [&[][..], &["--plan"][..]] {
            let message = fails(&[&base[..], plan].concat());
            assert!(message.contains(replay) && message.contains(expected), "{message}");
        }
    }
}

#[test]
fn faulty_configuration_file_reports_every_fault() {
    let toml = "cycle_us = 2000\nspeed = 3\n[[gateway]]\nn = 25\ncan0 = { bitrate = 500_000 }\n";
    let (_directory, config) = written(toml);
    let output = program::run("simple_loop", &["--ecrt", "sim", "--config", &config]);
    let message = text_of_failure(&output);
    assert!(message.starts_with(&format!("simple_loop: {config}: 2 faults\n")), "{message}");
    contains_all(&message, &["\n  - line 2, column 1: ", "\n  - line 4, column 5: "]);
    assert_eq!(text(&output.stdout), "", "no bus is touched");

    let output = program::run("simple_loop", &["--ecrt", "sim", "--config", "/no/such.toml"]);
    let message = text_of_failure(&output);
    assert!(message.starts_with("simple_loop: cannot read /no/such.toml: "), "{message}");
}

fn text_of_failure(output: &Output) -> String {
    assert_eq!(output.status.code(), Some(6));
    text(&output.stderr)
}

#[test]
fn configuration_file_conflicts_with_replaced_options() {
    let options: [&[&str]; 7] = [
        &["--slaves", "1"],
        &["--pdo-n", "3"],
        &["--large-pdos"],
        &["--bitrate", "1000000"],
        &["--fd", "2000000"],
        &["--cycle-us", "10000"],
        &["--master", "0"],
    ];
    for option in options {
        let message = fails(&[&["--ecrt", "sim", "--config", "cell.toml"], option].concat());
        assert!(message.contains("cannot be used with"), "{message}");
        assert!(message.contains("--config") && message.contains(option[0]), "{message}");
    }
}

#[test]
fn cycle_period_and_denied_settings_are_printed() {
    let base = ["--ecrt", "sim", "--cycles", "100", "--cycle-us", "1000"];
    assert!(!succeeds(&base).contains("master_period"), "not requested");
    let asked = ["--spin-us", "100", "--cpu", "4095"];
    let printed = succeeds(&[&base[..], &asked].concat());
    let rejected = "CPU 4095: not granted, the CPU is not there";
    assert!(
        printed.contains(rejected) && printed.contains("continuing without the denied settings"),
        "{printed}"
    );
    let exact = "master_period: min/max 1000.000/1000.000 us, mean 1000.000 us";
    let parts = ["max error 0.000 us", "overruns 0, skipped 0", "simulated times", exact];
    contains_all(&printed, &parts);

    let printed = succeeds(&[&base[..], &["--real-time", "--spin-us", "100"]].concat());
    contains_all(&printed, &["master_period: min/max ", "p99.9 ", "wake_up: ", "run_time: "]);
    assert!(!printed.contains("simulated times"), "{printed}");

    // Granted or not, in expected.
    let printed = succeeds(&[&base[..], &["--rt-priority", "1", "--lock-memory"]].concat());
    let memory = "\nlocked memory with 262144 bytes of stack: ";
    contains_all(&printed, &["\nSCHED_FIFO priority 1: ", memory]);

    let cases: &[(&[&str], &str)] = &[
        (&["--cpu", "4095", "--rt-required"], "no real-time thread: CPU 4095: not granted"),
        (&["--rt-priority", "200"], "1..=99"),
    ];
    program::all_fail("simple_loop", &base, cases);
}

#[test]
fn ctrl_c_stops_the_loop_with_a_summary() {
    let arguments = ["--ecrt", "sim", "--real-time", "--cycles", "1000000", "--cycle-us", "1000"];
    let rest = program::interrupt_after(command(&arguments), "ready");
    assert!(rest.contains("stopped by the user") && rest.contains("slave 0 can0"), "{rest}");
}
