//! `ecan probe` as a user runs it.

use crate::support::{assert_has, ends, fails, good, json_of, scenario, setting, simulated};

/// Lines about a row of docs/ASSUMPTIONS.md.
fn lines<'a>(printed: &'a str, row: &str) -> Vec<&'a str> {
    let of_row = |line: &&str| line.split_whitespace().nth(1) == Some(row);
    printed.lines().filter(of_row).collect()
}

#[test]
fn json_has_a_verdict_for_each_assumption() {
    let report = json_of(&simulated(&["--json", "probe"]));
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
    assert_has(&good(&["--ecrt", &ecrt, "probe"]), "no wired channels are given (--wired)");
    for wired in ["0-1", "3-2"] {
        let printed = good(&["--ecrt", &ecrt, "probe", "--wired", wired]);
        assert!(lines(&printed, "H9").iter().all(|line| line.starts_with("  holds ")), "{printed}");
    }
    let unwired = good(&["--ecrt", &ecrt, "probe", "--wired", "1-2"]);
    assert!(unwired.contains("did not reach the other channel: check the wiring"), "{unwired}");
}

#[test]
fn report_has_everything_and_is_written_once() {
    let directory = tempfile::tempdir().unwrap();
    let path = |name: &str| directory.path().join(name).display().to_string();
    let (file, profile) = (path("report.json"), path("gateway.toml"));
    let printed = simulated(&["probe", "--report", &file, "--write-profile", &profile]);
    assert_has(&printed, "\nselftest\ngateway 4294967297 at position 0: passed\n");
    let read = |name: &str| std::fs::read_to_string(directory.path().join(name)).unwrap();
    let report = json_of(&read("report.json"));
    let probe = &report["probe"];
    assert!(probe["findings"].as_array().unwrap().len() > 60);
    assert!(probe["command_line"].as_str().unwrap().starts_with("ecan --ecrt sim "), "{probe}");
    assert_eq!(
        (&probe["selftest"]["is_good"], &probe["is_restored"]),
        (&true.into(), &true.into())
    );
    let diagnosis = &report["diagnosis"];
    assert_eq!(
        (&diagnosis["format"], &diagnosis["failure"]),
        (&"ecan-diagnosis".into(), &().into())
    );
    assert_eq!(diagnosis["gateways"].as_array().unwrap().len(), 1);
    assert!(read("gateway.toml").contains("\nschedule_depth = 64\n"), "{}", read("gateway.toml"));
    assert_has(&good(&["diag", "--from", &file]), "slave 0, PREOP, ECAN-Lite, firmware 2.2.1");
    assert_has(&fails(6, &["--ecrt", "sim", "probe", "--report", &file]), "file exists");
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

#[test]
fn configuration_uses_the_profile_of_its_gateway() {
    let slow = "[[gateway]]\nboot_ms = 6000\n\
                sync0_window = { before_us = 150, after_us = 20, missed_limit = 10, al_status = 0x1A }\n\
                [gateway.variant]\nschedule_depth = 16\n[[node]]\nkind = \"echo\"\nbus = \"0.0\"\n";
    let bus = scenario(slow);
    let directory = tempfile::tempdir().unwrap();
    let path = |name: &str| directory.path().join(name).display().to_string();
    ends(1, &["--ecrt", &setting(&bus), "probe", "--write-profile", &path("gateway.toml")]);
    let cell = "cycle_us = 1000\ndc = {}\n[[gateway]]\nn = 3\ncan0 = { bitrate = 500_000 }\n";
    std::fs::write(path("plain.toml"), cell).unwrap();
    let with_profile = cell.replace("n = 3", "n = 3\ndevice_profile = \"gateway.toml\"");
    std::fs::write(path("cell.toml"), with_profile).unwrap();
    let check = |name: &str| good(&["config", "check", &path(name)]);
    let (plain, checked) = (check("plain.toml"), check("cell.toml"));
    assert!(checked.contains("\n         schedule_depth = 16: schedule.depth = 16\n"), "{checked}");
    let window = checked.lines().find(|line| line.contains("sync0_window_us = [")).unwrap();
    let (_, processing_us) = window.split_once("schedule.processing_us = ").unwrap();
    let processing_us: f64 = processing_us.parse().unwrap();
    assert!((110.0..=160.0).contains(&processing_us), "{checked}");
    // The shift of the plan is in the middle of what the longer time leaves.
    let shift = |text: &str| -> f64 {
        let line = text.lines().find_map(|line| line.strip_prefix("Sync0: ")).unwrap();
        line.split(' ').next().unwrap().parse().unwrap()
    };
    assert!((shift(&checked) - shift(&plain) - (processing_us - 50.0) / 2.0).abs() <= 1.0);
    let json = json_of(&good(&["--json", "config", "check", &path("cell.toml")]));
    let profile = &json["gateways"][0]["profile"];
    assert_eq!(profile["values"]["schedule_depth"], 16);
    let restart_ms = profile["values"]["restart_ms"].as_u64().unwrap();
    let timeout = format!("preop_timeout_ms = {}", restart_ms * 2);
    assert!(restart_ms > 6_000 && checked.contains(&timeout), "{checked}");

    let generate = |scenario_text: &str| {
        let bus = scenario(scenario_text);
        let options = ["--ecrt", &setting(&bus), "gen", "--config", &path("cell.toml"), "-n", "5"];
        let output = crate::support::ecan(&options);
        let text = |bytes| String::from_utf8(bytes).unwrap();
        (text(output.stdout), text(output.stderr))
    };
    let (printed, errors) = generate(slow);
    assert!(printed.starts_with("5 frames sent, 0 lost, "), "{printed}{errors}");
    assert!(!errors.contains("warning"), "{errors}");
    let (printed, errors) = generate(&slow.replace("boot_ms", "firmware = [2, 9]\nboot_ms"));
    assert!(printed.starts_with("5 frames sent, 0 lost, "), "{printed}{errors}");
    let warning = "warning: slave 0: its device profile was measured on a gateway with firmware 514.1; \
                   this one has 2.9; repeat `ecan probe --write-profile`";
    assert!(errors.contains(warning), "{errors}");
}
