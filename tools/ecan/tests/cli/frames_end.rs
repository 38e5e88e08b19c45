//! How runs of the commands that carry frames come to their end: stopped, unread, or on a gateway
//! that is lost.

use std::process::Command;

use crate::support::{Running, Scenario, assert_has, wait_for};

const ECHO: &str = "[[node]]\nkind = \"echo\"\nbus = \"0.0\"\n";

fn summary(bus: &Scenario, status: i32, arguments: &[&str]) -> (serde_json::Value, String) {
    let output = bus.run(&[arguments, &["--json"]].concat());
    let errors = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(status), "{errors}");
    (serde_json::from_slice(&output.stdout).unwrap(), errors)
}

/// What a run of `gen -v` says last when it is told to stop.
fn summary_line(running: &mut Running) -> String {
    running.terminate();
    loop {
        let line = running.line();
        if !line.starts_with("  can0 ") {
            return line;
        }
    }
}

#[test]
fn stalled_output_does_not_block_stopping() {
    let frames: Vec<(u64, &str)> = (0..6000).map(|at| (at, "123#11")).collect();
    let bus = Scenario::replaying(&frames, "");
    let capture = bus.path("bus.pcapng");
    let mut unread = bus.start(&["dump", "-n", "6000", "--capture", &capture, "--screen"]);
    assert_eq!(unread.line(), "  can0  123   [1]  11");
    // With all frames in the capture, more wait for the screen than a pipe takes.
    let written = || std::fs::metadata(&capture).map_or(0, |file| file.len());
    wait_for("all frames in the capture", || written() > 6000 * 48);
    unread.terminate();
    assert_has(&unread.ends(6), "cannot write the output: output is stalled");
}

#[test]
fn second_signal_exits_immediately() {
    let bus = Scenario::new(ECHO);
    let fifo = bus.path("fifo");
    assert!(Command::new("mkfifo").arg(&fifo).status().unwrap().success());
    // Nobody opens the other end, so it never gets as far as looking at a request to stop.
    let mut held = bus.start(&["gen", "--capture", &fifo]);
    // Then signals are caught.
    held.wait_for_error("SIMULATED");
    held.terminate_until_ended();
    held.ends(130);
}

#[test]
fn stopped_gen_reports_no_losses() {
    let bus = Scenario::new(ECHO);
    let mut running = bus.start(&["gen", "-g", "1", "-v"]);
    for _ in 0..20 {
        assert!(running.line().starts_with("  can0 "));
    }
    let line = summary_line(&mut running);
    assert!(line.contains(" frames sent, 0 lost, ") && !line.contains("in transit"), "{line}");
    running.ends(0);
}

#[test]
fn unacknowledged_frames_are_in_transit_when_stopped() {
    let alone = Scenario::new("");
    let mut running = alone.start(&["gen", "-g", "1", "-v"]);
    for _ in 0..5 {
        assert!(running.line().starts_with("  can0 "));
    }
    let line = summary_line(&mut running);
    assert!(
        line.starts_with("0 frames sent, 0 lost, ") && line.contains(" in transit, "),
        "{line}"
    );
    assert_eq!(running.wait().0, Some(0));
}

#[test]
fn lost_gateway_is_reported() {
    let fault = "[[fault]]\nat_ms = 9000\nkind = \"power_off\"\ngateway = 0\n";
    let bus = Scenario::new(&format!("{ECHO}{fault}"));
    let (summary, errors) = summary(&bus, 5, &["gen", "--seed", "1", "-n", "20000", "-g", "1"]);
    assert!(errors.contains("slave 0: lost, waits for "), "{errors}");
    assert!(!errors.contains("bus load"), "{errors}");
    let of = |name: &str| summary[name].as_u64().unwrap();
    // What left long before the loss has left; what the channel may have held then is not known.
    assert!(of("sent") > 1000 && of("lost") < 20, "{summary}");
    assert_eq!(of("sent") + of("lost") + of("not_tried"), 20_000);

    let message = bus.fails(5, &["dump", "-T", "20000"]);
    assert!(message.contains("slave 0: lost, waits for the slave to answer"), "{message}");
    assert!(message.trim_end().ends_with(": no frame received"), "{message}");
}

#[test]
fn frames_of_lost_gateway_are_not_counted_as_sent() {
    let fault = "[[fault]]\nat_ms = 9000\nkind = \"power_cycle\"\ngateway = 0\noff_ms = 300\n";
    let bus = Scenario::new(&format!("{ECHO}{fault}"));
    let (summary, errors) =
        summary(&bus, 5, &["gen", "--seed", "1", "-n", "50000", "-g", "0", "-L", "8"]);
    assert!(errors.contains("slave 0: lost temporarily: "), "{errors}");
    let of = |name: &str| summary[name].as_u64().unwrap();
    assert_eq!(of("sent") + of("lost"), 50_000);
    // Its cache holds 64 frames, the controller 32, and images were under way.
    assert!((20..500).contains(&of("lost")), "{summary}");
    // What came back had left. The status counts to 7 only, so that frames of the last moment may be
    // in doubt although they did: never more than the channel holds.
    assert!(of("sent") + 64 + 32 >= of("received"), "{summary}");
}

#[test]
fn failed_bus_leaves_a_summary() {
    let fault = "[[fault]]\nat_ms = 9000\nkind = \"library_error\"\ncall = \"receive\"\n\
                 errno = \"EIO\"\ntimes = 1000\n";
    let bus = Scenario::new(&format!("{ECHO}{fault}"));
    let log: String = (0..20_000)
        .map(|at| format!("({}.{:03}000) can0 123#01\n", at / 1000, at % 1000))
        .collect();
    let drive = bus.write("drive.log", &log);
    for command in [&["gen", "--seed", "1", "-n", "20000", "-g", "1"][..], &["replay", &drive]] {
        let (summary, errors) = summary(&bus, 3, command);
        assert!(summary["sent"].as_u64().unwrap() > 1000, "{summary}");
        assert!(errors.contains("receive"), "{errors}");
    }
}

#[test]
fn gen_and_replay_measure_equally() {
    let bus = Scenario::new(ECHO);
    let drive = bus.write(
        "drive.log",
        "(0.000000) can0 123#01\n(0.001000) can0 123#01\n(0.002000) can0 123#01\n",
    );
    let generated = ["gen", "-n", "3", "-g", "1", "-I", "123", "-L", "1", "-D", "01"];
    let (generated, _) = summary(&bus, 0, &generated);
    let (replayed, _) = summary(&bus, 0, &["replay", &drive]);
    assert_eq!(generated["frames_per_second"], replayed["frames_per_second"]);
    let rate = replayed["frames_per_second"].as_f64().unwrap();
    assert!((500.0..=1000.0).contains(&rate), "{rate}");
}
