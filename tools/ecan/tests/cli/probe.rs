//! `ecan probe` as a user runs it.

use crate::support::{ends, fails, good, scenario, setting, simulated};

/// Lines about a row of docs/ASSUMPTIONS.md.
fn lines<'a>(printed: &'a str, row: &str) -> Vec<&'a str> {
    let of_row = |line: &&str| line.split_whitespace().nth(1) == Some(row);
    printed.lines().filter(of_row).collect()
}

#[test]
fn json_has_a_verdict_for_each_assumption() {
    let report: serde_json::Value = serde_json::from_str(&simulated(&["--json", "probe"])).unwrap();
    let findings = report["findings"].as_array().unwrap();
    for finding in findings {
        let verdict = finding["verdict"].as_str().unwrap();
        assert!(["holds", "undecided"].contains(&verdict), "{finding}");
        assert!(finding["rows"][0].is_string() && finding["detail"] != "", "{finding}");
    }
    assert!(findings.len() > 60);
    assert_eq!(report["profile"]["internal_loopback"], 2);
    assert_eq!((&report["is_restored"], &report["is_simulated"]), (&true.into(), &true.into()));
}

#[test]
fn difference_ends_with_status_1() {
    let bus = scenario("[[gateway]]\n[gateway.variant]\nnode_modes = \"loopback_first\"\n");
    let printed = ends(1, &["--ecrt", &setting(&bus), "probe"]);
    let [line, _wired] = lines(&printed, "H9")[..] else { panic!("{printed}") };
    assert!(line.starts_with("  DIFFERS    H9 "), "{line}");
    assert!(printed.contains("node mode 1 sets the controller to internal loopback\n"));
    assert!(printed.ends_with("configuration: as before the probe, by a restart\n"), "{printed}");
}

#[test]
fn wired_channels_are_tried_on_request() {
    let bus = scenario("[[gateway]]\nbuses = [\"a\", \"a\", \"b\", \"b\"]\n");
    let ecrt = setting(&bus);
    let without = good(&["--ecrt", &ecrt, "probe"]);
    assert!(without.contains("no wired channels are given (--wired)"), "{without}");
    for wired in ["0-1", "3-2"] {
        let printed = good(&["--ecrt", &ecrt, "probe", "--wired", wired]);
        assert!(lines(&printed, "H9").iter().all(|line| line.starts_with("  holds ")), "{printed}");
    }
    let unwired = good(&["--ecrt", &ecrt, "probe", "--wired", "1-2"]);
    assert!(unwired.contains("did not reach the other channel: check the wiring"), "{unwired}");
}

#[test]
fn bundle_and_profile_are_written_once() {
    let directory = tempfile::tempdir().unwrap();
    let path = |name: &str| directory.path().join(name).display().to_string();
    let (bundle, profile) = (path("bundle"), path("gateway.toml"));
    let printed = simulated(&["probe", "--bundle", &bundle, "--write-profile", &profile]);
    let read = |name: &str| std::fs::read_to_string(directory.path().join(name)).unwrap();
    assert_eq!(read("bundle/probe.txt"), printed);
    for (file, key) in [("bundle/probe.json", "findings"), ("bundle/diagnosis.json", "snapshot")] {
        let json: serde_json::Value = serde_json::from_str(&read(file)).unwrap();
        assert!(!json[key].is_null(), "{file}");
    }
    assert!(read("gateway.toml").contains("\nschedule_depth = 64\n"), "{}", read("gateway.toml"));
    let message = fails(6, &["--ecrt", "sim", "probe", "--bundle", &bundle]);
    assert!(message.contains("cannot create"), "{message}");
}

#[test]
fn missing_objects_are_named_without_a_restart() {
    let bus = scenario(
        "[[gateway]]\n[gateway.variant]\nmissing_entries = [\"0xF000:4..8\", \"0x8021\"]\n",
    );
    let printed = ends(1, &["--ecrt", &setting(&bus), "probe"]);
    assert!(printed.contains("missing: 0xF000:4..8, 0x8021\n"), "{printed}");
    assert!(printed.contains("the configuration could not be read to restore it"), "{printed}");
    assert!(printed.ends_with("configuration: not changed\n"), "{printed}");
}
