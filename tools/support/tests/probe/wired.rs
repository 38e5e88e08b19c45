//! The last stage of the probe: frames between two wired channels.

use std::path::Path;

use ecan_sim::{ClockKind, Scenario, SimOptions};
use ecan_tool_support::probe::{DeviceProfile, Finding, Probe, ProbeOptions, Stage, Verdict};

fn probe(buses: &str, keys: &str) -> (Vec<Finding>, DeviceProfile) {
    let text = format!("[[gateway]]\nbuses = {buses}\n{keys}");
    let scenario = Scenario::from_toml(&text, "wired", Path::new(".")).unwrap();
    let options = SimOptions { clock: Some(ClockKind::Stepped), ..SimOptions::default() };
    let backend = ecan_sim::open_scenario(scenario, &options).unwrap();
    let options = ProbeOptions { wired: Some((0, 1)), ..ProbeOptions::default() };
    let mut probe = Probe::open(&backend.ecrt, 0, 0, options).unwrap();
    let findings = probe.run(|_| ());
    (findings, probe.device_profile().clone())
}

const WIRED: &str = "[\"w\", \"w\", \"a\", \"b\"]";

fn sample_point(findings: Vec<Finding>) -> Finding {
    let is_wanted =
        |finding: &Finding| finding.stage == Some(Stage::Wired) && finding.key == "bit_timing";
    findings.into_iter().find(is_wanted).unwrap()
}

/// The registers show the choice in another stage: both agree.
#[test]
fn error_counters_show_the_sample_point_of_each_choice() {
    for (choice, expected, verdict, name) in [
        ("middle", 812, Verdict::Holds, None),
        ("lowest", 750, Verdict::Differs, Some("lowest")),
        ("highest", 875, Verdict::Differs, Some("highest")),
    ] {
        let (findings, profile) =
            probe(WIRED, &format!("variant = {{ bit_timing = \"{choice}\" }}"));
        let finding = sample_point(findings);
        assert_eq!(finding.verdict, verdict, "{finding:?}");
        assert_eq!(finding.alternative.as_deref(), name, "{finding:?}");
        let found = profile.wired_sample_point_permille.unwrap();
        assert!(found.abs_diff(expected) <= 6, "{choice}: {found}");
        assert!(profile.sample_point_permille.unwrap().abs_diff(found) <= 6, "{choice}: {found}");
    }
}

/// The driver takes 80 % from this window.
#[test]
fn error_counters_do_not_take_the_driver_for_the_middle() {
    let (findings, profile) = probe(WIRED, "variant = { bit_timing = \"driver\" }");
    let finding = sample_point(findings);
    assert_eq!(
        (finding.verdict, finding.alternative),
        (Verdict::Differs, None),
        "{}",
        finding.detail
    );
    assert!(profile.wired_sample_point_permille.unwrap().abs_diff(800) <= 6);
}

#[test]
fn controller_shows_the_delay_of_its_transceiver() {
    for (delay, measured, verdict, name) in [
        (150, 150, Verdict::Holds, None),
        (250, 250, Verdict::Differs, Some("250")),
        (90, 87, Verdict::Differs, Some("87")),
    ] {
        let (findings, profile) = probe(WIRED, &format!("transceiver_ns = {delay}"));
        let finding = findings.into_iter().find(|finding| finding.key == "transceiver_ns").unwrap();
        assert_eq!(finding.verdict, verdict, "{finding:?}");
        assert_eq!(finding.alternative.as_deref(), name, "{finding:?}");
        assert_eq!(profile.transceiver_ns, Some(measured));
    }
}

#[test]
fn channels_without_wire_leave_the_sample_point_undecided() {
    let (findings, profile) = probe("[\"w\", \"v\", \"a\", \"b\"]", "");
    let finding = sample_point(findings);
    assert_eq!(finding.verdict, Verdict::Undecided);
    assert!(finding.detail.contains("frames fail at each sample point: check the wiring"));
    assert_eq!(profile.wired_sample_point_permille, None);
}
