//! `ecan selftest` in parallel with the program that holds the bus.

use crate::serve::{Served, serve_bus};
use crate::support::{ends, json_of, scenario, setting};

/// Channels 0 and 1 are wired; a node acknowledges on channel 2.
const WIRED: &str = "[[gateway]]\nbuses = [\"wire\", \"wire\", \"other\", \"free\"]\n\
                     [[node]]\nkind = \"silent\"\nbus = \"other\"\n";
const OPTIONS: [&str; 2] = ["--bitrate", "500000"];

fn serve_wired(nodes: &str, options: &[&str]) -> Served {
    let file = scenario(&format!("{WIRED}{nodes}"));
    let mut served = serve_bus(&setting(&file), options);
    if !options.contains(&"--idle") {
        served.program.wait_for_error("slave 0: ready");
    }
    served
}

impl Served {
    fn selftest(&self, status: i32, arguments: &[&str]) -> String {
        let test = ["--via", &self.path, "selftest", "--frames", "12"];
        let observe = if arguments.contains(&"--force") { &[][..] } else { &["--observe", "50"] };
        ends(status, &[&test, observe, arguments].concat())
    }
}

/// Lines of the report with this text.
fn lines<'a>(report: &'a str, text: &str) -> Vec<&'a str> {
    report.lines().filter(|line| line.contains(text)).collect()
}

#[test]
fn wired_channels_are_tested_in_parallel_with_the_service() {
    let served = serve_wired("", &OPTIONS);
    let report = served.selftest(0, &["--wired", "0-1"]);
    let title = "gateway 4294967297 at position 0: passed, 2 not tested";
    assert_eq!(report.lines().next(), Some(title));
    assert_eq!(lines(&report, "12 frames, no errors").len(), 2, "{report}");
    assert!(report.contains("wire from channel 1 to 0, 500 kbit/s"), "{report}");
    assert_eq!(lines(&report, "OP, ready").len(), 1, "{report}");
    assert_eq!(lines(&report, "run, no errors").len(), 4, "{report}");
    for left_out in ["-       loopback", "-       bit rates"] {
        let [line] = lines(&report, left_out)[..] else { panic!("{report}") };
        assert!(line.contains("not tested: ") && line.contains("ecan serve"), "{line}");
    }
    let json = json_of(&served.selftest(0, &["--json"]));
    assert_eq!((&json["is_good"], &json["is_complete"]), (&true.into(), &false.into()));
    let checks = json["gateways"][0]["checks"].as_array().unwrap();
    assert_eq!(checks.iter().filter(|check| check["is_good"].is_null()).count(), 2);

    // Nothing acknowledges on channel 3.
    let report = served.selftest(1, &["--wired", "2-3", "--channels", "0"]);
    assert_eq!(lines(&report, "0 of 12 frames received").len(), 2, "{report}");
    assert!(report.contains("from channel 3 to channel 2 and its termination"), "{report}");
    served.end();
}

#[test]
fn wires_that_cannot_be_tested_have_a_reason() {
    let left_out = |served: &Served, pair: &str| {
        let report = served.selftest(0, &["--wired", pair, "--channels", "2"]);
        let [line] = lines(&report, "wire between")[..] else { panic!("{report}") };
        line.split_once("not tested: ").unwrap().1.to_owned()
    };
    let babble = "[[node]]\nkind = \"faulty\"\nbus = \"wire\"\nbabble_us = 2000\n";
    let served = serve_wired(babble, &OPTIONS);
    let reason = left_out(&served, "0-1");
    assert!(reason.starts_with("traffic within 50 ms: "), "{reason}");
    let report = served.selftest(1, &["--wired", "0-1", "--channels", "2", "--force"]);
    assert!(report.contains("from another sender"), "{report}");
    served.end();

    let served = serve_wired("", &[&OPTIONS[..], &["--read-only"]].concat());
    let reason = left_out(&served, "0-1");
    assert!(reason.contains("ecan serve") && reason.contains("read-only"), "{reason}");
    served.end();

    let served = serve_wired("", &["--idle"]);
    let reason = left_out(&served, "0-1");
    assert!(reason.ends_with("runs no cycle"), "{reason}");
    served.end();
}
