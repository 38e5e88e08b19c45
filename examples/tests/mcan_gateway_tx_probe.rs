//! `mcan_gateway_tx_probe` as a user runs it.

use crate::program::{self, text};

const NAME: &str = "mcan_gateway_tx_probe";
const SIM: [&str; 4] = ["--ecrt", "sim", "--frames", "1000"];
/// Stable point of the manual (15.6.1), later than the planned one: the scenario wakes up to 600 us late.
const PROVEN_SHIFT: [&str; 2] = ["--dc-shift-us", "700"];

fn succeeds(arguments: &[&str]) -> String {
    program::succeeds(NAME, arguments)
}

fn fails(arguments: &[&str]) -> String {
    program::fails(NAME, arguments)
}

/// Numbers of a row of the table: frames on the bus, then bus min, max, p95, p99 in microseconds
/// and order errors.
fn row(printed: &str, mode: &str) -> (String, Vec<f64>) {
    let line = printed.lines().find(|line| line.starts_with(mode) && line.contains(" ("));
    let line = line.unwrap_or_else(|| panic!("no row of {mode} in: {printed}"));
    let (_, cells) = line.split_once(") ").unwrap();
    let mut cells = cells.split_whitespace();
    let on_bus = cells.next().unwrap().to_owned();
    let numbers = cells.flat_map(|cell| cell.split('/')).map(|number| number.parse().unwrap());
    (on_bus, numbers.collect())
}

#[test]
fn table_compares_direct_and_scheduled_sending() {
    // Manual 13.9: CAN FD with N = 3.
    let fd = ["--fd", "5000000", "--pdo-n", "3"];
    let printed = succeeds(&[&SIM[..], &PROVEN_SHIFT[..], &fd[..]].concat());
    assert!(printed.starts_with("SIMULATED") && printed.contains("Scenario jitter"), "{printed}");
    assert_eq!(printed.matches("master_period: min/max ").count(), 2, "{printed}");
    assert!(printed.contains("scheduled 100 us: margin "), "{printed}");
    let (on_bus, scheduled) = row(&printed, "scheduled");
    assert_eq!(on_bus, "1000/1000");
    let [min, max, p95, p99, order] = scheduled[..] else { panic!("{printed}") };
    assert!(min >= 944.0 && max <= 1032.0 && p95 <= 1012.0 && p99 <= 1012.0, "{printed}");
    assert_eq!(order, 0.0);
    let (on_bus, direct) = row(&printed, "direct");
    assert_eq!(on_bus, "1000/1000");
    assert!(direct[1] - direct[0] > 10.0 * (max - min), "{printed}");
    assert!(direct[3] - 1000.0 > 10.0 * (p99 - 1000.0), "{printed}");
    assert!(printed.contains("1000 sent, 0 rejected"), "{printed}");
    assert!(printed.contains("times on the bus from the simulated bus"), "{printed}");
}

#[test]
fn single_mode_with_spin_and_other_cycle_runs() {
    let p95 = |arguments: &[&str]| {
        let printed = succeeds(&[&SIM[..], &["--mode", "direct"], arguments].concat());
        assert!(!printed.contains("scheduled"), "{printed}");
        row(&printed, "direct").1[2]
    };
    assert!(p95(&["--spin-us", "100"]) < p95(&[]) - 20.0);
    let arguments = ["--mode", "scheduled", "--cycle-us", "2000", "--offset-ns", "250000"];
    let printed = succeeds(&[&SIM[..], &arguments].concat());
    assert!(!printed.contains("direct"), "{printed}");
    let numbers = row(&printed, "scheduled 250 us").1;
    assert!(numbers[0] >= 1986.0 && numbers[1] <= 2014.0, "13.9: {printed}");
}

#[test]
fn same_seed_on_other_channel_gives_same_result() {
    let place = ["--slaves", "2", "--slave", "1", "--channel", "3", "--seed", "5"];
    let arguments = [&SIM[..], &PROVEN_SHIFT[..], &place[..]].concat();
    let results = || {
        let printed = succeeds(&arguments);
        let (before, from_date) = printed.split_once("date: ").unwrap();
        format!("{before}{}", from_date.split_once('\n').unwrap().1)
    };
    let printed = results();
    assert_eq!(row(&printed, "scheduled").0, "1000/1000");
    assert_eq!(printed, results());
}

#[test]
fn files_contain_every_frame_and_a_complete_picture() {
    let directory = tempfile::tempdir().unwrap();
    let path = |name: &str| directory.path().join(name).display().to_string();
    let (csv, html, svg, log) = (path("p.csv"), path("p.html"), path("p.svg"), path("bus.log"));
    let simulated =
        [&SIM[..], &PROVEN_SHIFT, &["--csv", &csv, "--report", &html, "--bus-dump", &log]].concat();
    let simulated = succeeds(&simulated);
    let lines = std::fs::read_to_string(&csv).unwrap();
    let mut lines = lines.lines();
    assert_eq!(lines.next(), Some("mode,number,cycle_start_ns,bus_ns,bus_period_ns"));
    let frames: Vec<Vec<&str>> = lines.map(|line| line.split(',').collect()).collect();
    assert_eq!(frames.len(), 2_000);
    for (number, frame) in frames.iter().enumerate() {
        assert_eq!(frame[0], if number < 1_000 { "direct" } else { "scheduled" });
        assert_eq!(frame[1], number.to_string());
        let [start, bus]: [u64; 2] = [2, 3].map(|place| frame[place].parse().unwrap());
        assert!(bus > start && bus - start < 2_000_000, "{frame:?}");
        assert_eq!(frame[4].is_empty(), number % 1_000 == 0, "{frame:?}");
    }
    let page = std::fs::read_to_string(&html).unwrap();
    let command_line = format!("{NAME} --ecrt sim");
    for part in [
        "SIMULATED",
        "1000/1000",
        "<svg",
        "direct: period on the bus",
        "<th>date</th><td class=\"fact\">20",
        "<th>kernel</th><td class=\"fact\">Linux ",
        &format!("<th>program</th><td class=\"fact\">{NAME} {}", env!("CARGO_PKG_VERSION")),
        &command_line,
        "</html>",
    ] {
        assert!(page.contains(part), "{part}");
    }
    for outside in ["<script", "<link", "src=", "href="] {
        assert!(!page.contains(outside), "{outside}");
    }
    assert!(!page.contains("NaN") && !page.contains("inf"), "numbers only");

    // The same times from a log, as an analyser would have written it.
    let from_log = [&SIM[..], &PROVEN_SHIFT, &["--bus-log", &log, "--report", &svg]].concat();
    let from_log = succeeds(&from_log);
    assert_eq!(row(&from_log, "direct"), row(&simulated, "direct"));
    assert_eq!(row(&from_log, "scheduled"), row(&simulated, "scheduled"));
    assert!(from_log.contains(&format!("times on the bus from {log}")), "{from_log}");
    let svg = std::fs::read_to_string(&svg).unwrap();
    assert!(svg.starts_with("<svg") && svg.contains(&command_line), "{svg}");
}

/// A candump log of the probe's frames with these numbers, a millisecond apart, in microseconds.
fn write_log(path: &str, numbers: &[u64]) {
    let line = |(nth, number): (usize, &u64)| {
        let data: String = number.to_le_bytes().iter().map(|byte| format!("{byte:02X}")).collect();
        format!("(1700000000.{:06}) can0 123#{data}\n", 1_000 * nth + 3)
    };
    std::fs::write(path, numbers.iter().enumerate().map(line).collect::<String>()).unwrap();
}

#[test]
fn analyser_log_shows_losses_order_and_resolution() {
    let directory = tempfile::tempdir().unwrap();
    let log = directory.path().join("analyser.log").display().to_string();
    // 2 is lost, 5 and 4 have changed places, 6 came twice.
    write_log(&log, &[0, 1, 3, 5, 4, 6, 6, 7, 8, 9]);
    let arguments = ["--ecrt", "sim", "--mode", "direct", "--frames", "10", "--bus-log", &log];
    let printed = succeeds(&arguments);
    let (on_bus, numbers) = row(&printed, "direct");
    assert_eq!(on_bus, "9/10");
    assert_eq!(numbers, [1_000.0, 2_000.0, 2_000.0, 2_000.0, 1.0], "{printed}");
    assert!(printed.contains("whole microseconds"), "{printed}");
    std::fs::write(&log, "(1700000000.000001) can0 124#00\n").unwrap();
    assert!(fails(&arguments).contains("contains no numbered frame"));
    let output = program::run(NAME, &arguments);
    let printed = text(&output.stdout);
    assert!(printed.contains("master_period: min/max ") && printed.contains("?/10"), "{printed}");
}

#[test]
fn recommended_phase_of_a_sweep_loses_no_frame() {
    let directory = tempfile::tempdir().unwrap();
    let plot = directory.path().join("shifts.svg").display().to_string();
    let printed = succeeds(&["--ecrt", "sim", "--sweep", "--frames", "300", "--report", &plot]);
    let shifts = printed.lines().find(|line| line.starts_with("DC Sync0")).unwrap();
    assert!(shifts.contains("1 ms") && shifts.contains("384B"), "{shifts}");
    let svg = std::fs::read_to_string(&plot).unwrap();
    assert!(svg.contains("1 ms, 384B") && svg.ends_with("</svg>\n"), "{svg}");
    assert_eq!(printed.matches("<- recommended").count(), 1, "{printed}");
    let hint = printed.lines().last().unwrap();
    let (_, options) = hint.split_once(": ").unwrap();
    let mut expected: Vec<&str> = options.split_whitespace().collect();
    assert_eq!(expected.pop(), Some("120000"), "two minutes: {hint}");
    expected.pop();
    let run = succeeds(&[&SIM[..], &["--mode", "scheduled"], &expected].concat());
    assert_eq!(row(&run, "scheduled").0, "1000/1000");
    assert!(run.contains("1000 sent, 0 rejected"), "{run}");
}

#[test]
fn late_frames_are_dropped_and_reported() {
    let directory = tempfile::tempdir().unwrap();
    let scenario = directory.path().join("slow.toml");
    // The firmware is at hand 0 to 300 us after the image has arrived.
    let toml = "[[gateway]]\nservice_jitter_us = 300\n[[node]]\nkind = \"echo\"\nbus = \"0.0\"\n";
    std::fs::write(&scenario, toml).unwrap();
    let ecrt = format!("sim:{}", scenario.display());
    let arguments = ["--ecrt", &ecrt, "--mode", "scheduled", "--dc-shift-us", "150"];
    let output = program::run(NAME, &[&arguments[..], &["--offset-ns", "20000"]].concat());
    let (printed, errors) = (text(&output.stdout), text(&output.stderr));
    assert!(output.status.success(), "{errors}");
    assert!(errors.starts_with("warning: Sync0 150.0 us after the start"), "{errors}");
    assert!(printed.contains("margin -"), "it was said before: {printed}");
    assert!(printed.contains("0xB000:06 has SCHED_LATE_DROP"), "{printed}");
    let line = printed.lines().find(|line| line.contains(" sent,")).unwrap();
    let number = |expected: &str| -> u64 {
        let (before, _) = line.split_once(expected).unwrap_or_else(|| panic!("{line}"));
        before.rsplit([' ', ':']).next().unwrap().parse().unwrap()
    };
    let (sent, unknown) = (number(" sent,"), number(" unknown"));
    let (on_bus, _) = row(&printed, "scheduled");
    let on_bus: u64 = on_bus.strip_suffix("/1000").unwrap().parse().unwrap();
    assert!(
        sent + unknown == 1_000 && sent <= on_bus && on_bus < 900,
        "{on_bus} on the bus: {line}"
    );
}

#[test]
fn real_time_run_uses_the_system_clock() {
    let arguments = ["--ecrt", "sim", "--real-time", "--frames", "50", "--rt-priority", "1"];
    let printed = succeeds(&arguments);
    assert!(printed.contains("SCHED_FIFO priority 1: "), "{printed}");
    assert!(printed.contains("real time") && !printed.contains("simulated times"), "{printed}");
}

#[test]
fn wrong_use_returns_a_helpful_message() {
    let cases: &[(&[&str], &str)] = &[
        (&["--slave", "1"], "--slave 1 is out of range; allowed: 0 to 0"),
        (&["--slaves", "0"], "--slaves"),
        (&["--channel", "4"], "--channel"),
        (&["--frames", "0"], "--frames"),
        (&["--mode", "sideways"], "--mode"),
        (&["--offset-ns", "1000000"], "not below the Sync0 period of 1000.0 us"),
        (&["--dc-shift-us", "1000"], "shift"),
        (&["--report", "probe.png"], ".html or .svg"),
        (&["--report", "/no/such/dir/probe.html"], "cannot write /no/such/dir/probe.html"),
        (&["--csv", "/no/such/dir/probe.csv"], "cannot write /no/such/dir/probe.csv"),
        (&["--bus-log", "/no/such.log"], "cannot read /no/such.log"),
        (&["--sweep", "--csv", "a.csv"], "cannot be used with"),
        (&["--sweep", "--report", "a.html"], "--report of --sweep: only SVG is written"),
        (&["--pdo-n", "12"], "at most 11"),
    ];
    program::all_fail(NAME, &["--ecrt", "sim"], cases);
    program::all_fail(NAME, &[], &[(&["--ecrt", "/no/such/libethercat.so.1"], "was not found")]);
}
