//! Mutation score: the probe against the default gateway, and against each alternative of each switch.

use std::collections::BTreeSet;
use std::path::Path;

use ecan_sim::variant::{Alternative, Variant, variants};
use ecan_sim::{ClockKind, Scenario, SimOptions};
use ecan_tool_support::probe::{Finding, Probe, ProbeOptions, UNDECIDABLE, Verdict, experiments};

fn probe(variant: &str) -> Vec<Finding> {
    probe_scenario(&format!("[[gateway]]\n{variant}"))
}

fn probe_scenario(text: &str) -> Vec<Finding> {
    let scenario = Scenario::from_toml(text, "probe", Path::new("."));
    let scenario = scenario.unwrap_or_else(|error| panic!("{text}{error}"));
    let options = SimOptions { clock: Some(ClockKind::Stepped), ..SimOptions::default() };
    let backend = ecan_sim::open_scenario(scenario, &options).unwrap();
    Probe::open(&backend.ecrt, 0, 0, ProbeOptions::default()).unwrap().run(|_| ())
}

/// The gateway with one alternative. The abort code shows only with an entry that is missing.
fn probe_alternative(variant: &'static Variant, alternative: &'static Alternative) -> Vec<Finding> {
    let mut text = variant.toml(alternative);
    if variant.key == "missing_abort" {
        text += "missing_entries = [\"0x9020\"]\n";
    }
    probe(&text)
}

fn number(text: &str) -> Option<i64> {
    let text = text.replace('_', "");
    match text.strip_prefix("0x") {
        Some(digits) => i64::from_str_radix(digits, 16).ok(),
        None => text.parse().ok(),
    }
}

/// Deviation of a measured number from that of the alternative.
fn tolerance(key: &str, expected: i64) -> std::ops::RangeInclusive<i64> {
    match key {
        // With the master's scan.
        "boot_ms" => expected..=expected + 2_000,
        "mailbox_delay_us" => expected - 1_000..=expected + 3_000,
        "service_period_us" | "service_jitter_us" => expected * 8 / 10..=expected * 12 / 10,
        "service_delay_us" => expected..=expected + 20,
        "release_jitter_us" => expected - 4..=expected,
        _ => expected..=expected,
    }
}

/// Returns whether a finding names the alternative.
fn names(finding: &Finding, variant: &Variant, alternative: &Alternative) -> bool {
    let Some(found) = &finding.alternative else { return false };
    let expected = alternative.value.trim_matches('"');
    let is_equal = match (number(expected), number(found)) {
        (Some(expected), Some(found)) => tolerance(variant.key, expected).contains(&found),
        _ => expected == found,
    };
    finding.key == variant.key && finding.verdict == Verdict::Differs && is_equal
}

/// Alternatives that differ from the default, of the switches with an experiment.
fn alternatives() -> impl Iterator<Item = (&'static Variant, &'static Alternative)> {
    variants().flat_map(|variant| {
        variant.alternatives.iter().skip(1).map(move |alternative| (variant, alternative))
    })
}

#[test]
fn every_switch_has_an_experiment_or_a_reason() {
    let decided = experiments().map(|experiment| (experiment.key, experiment.rows));
    let known: Vec<_> = decided
        .chain(UNDECIDABLE.iter().map(|assumption| (assumption.key, assumption.rows)))
        .collect();
    for variant in variants() {
        let rows = known.iter().filter(|known| known.0 == variant.key).flat_map(|known| known.1);
        let rows: BTreeSet<_> = rows.collect();
        let expected: BTreeSet<_> = variant.assumptions.iter().collect();
        assert_eq!(rows, expected, "{}", variant.key);
    }
    for (key, _) in known.iter().filter(|known| !known.0.is_empty()) {
        assert!(variants().any(|variant| variant.key == *key), "{key} is not a switch");
    }
    let reasons = UNDECIDABLE.iter().filter(|assumption| assumption.key.is_empty());
    let mut rows: Vec<_> = reasons.flat_map(|reason| reason.rows).collect();
    rows.sort_unstable();
    assert!(rows.windows(2).all(|pair| pair[0] != pair[1]), "a row occurs twice: {rows:?}");
}

#[test]
fn default_gateway_has_no_difference() {
    let like_igh = "[master]\nlike = \"igh\"\n[[gateway]]\n";
    for finding in probe("").into_iter().chain(probe_scenario(like_igh)) {
        assert_ne!(finding.verdict, Verdict::Differs, "{finding:?}");
    }
}

/// Alternatives that the probe cannot distinguish from others or does not find, with the reason.
const NOT_NAMED: &[(&str, &str, &str)] = &[
    (
        "reboot_delay_ms",
        "1",
        "found as a missing answer, as with 0: the master fetches it too late",
    ),
    ("rotation_direction", "\"down\"", "shows only at the connectors"),
    ("bus_off_wait", "\"none\"", "needs a bus-off, which the probe does not cause"),
    ("publishes_after_read", "true", "the master sets the distance between LWR and LRD"),
    ("transceiver_ns", "250", "needs two wired channels"),
];

/// Other assumptions that an alternative contradicts, too: switch and row.
const CONSEQUENCES: &[(&str, &str)] = &[
    // A late service needs the image earlier before the pulse.
    ("service_period_us", "H24"),
    ("service_delay_us", "H24"),
    ("service_jitter_us", "H24"),
    // Found by the same value.
    ("filter_index", "H16"),
    // Its frames are late.
    ("scheduled_pulse", "H24"),
    // Switched together with a missing entry.
    ("missing_abort", "H42"),
];

#[test]
fn each_alternative_is_named_and_no_other() {
    let mut not_named = Vec::new();
    let mut all = 0;
    for (variant, alternative) in alternatives() {
        all += 1;
        let findings = probe_alternative(variant, alternative);
        let is_other = |finding: &&Finding| {
            let consequence = |row: &&str| CONSEQUENCES.contains(&(variant.key, row));
            finding.verdict == Verdict::Differs
                && finding.key != variant.key
                && !finding.rows.iter().any(consequence)
        };
        let others: Vec<_> = findings.iter().filter(is_other).collect();
        assert!(others.is_empty(), "{} = {}: {others:#?}", variant.key, alternative.value);
        if !findings.iter().any(|finding| names(finding, variant, alternative)) {
            let of_key: Vec<_> =
                findings.into_iter().filter(|finding| finding.key == variant.key).collect();
            not_named.push((variant.key, alternative.value, of_key));
        }
    }
    println!("alternatives named: {} of {all}", all - not_named.len());
    for (key, value, of_key) in &not_named {
        let known = NOT_NAMED.iter().find(|known| (known.0, known.1) == (*key, *value));
        let reason = known.map(|known| known.2);
        println!("  {key} = {value}: {}", reason.unwrap_or("NOT NAMED"));
        assert!(reason.is_some(), "{key} = {value}: {of_key:#?}");
    }
    assert_eq!(not_named.len(), NOT_NAMED.len(), "a reason is outdated");
}

/// Rows about the host, the master, the wires or the model of the simulator.
const NOT_OF_THE_DEVICE: &[&str] = &[
    "H12", "H15", "H30", "H33", "H46", "H52", "S22", "S24", "S25", "S28", "S29", "S32", "S33",
    "S52", "S57",
];

/// The rows H and S of docs/ASSUMPTIONS.md that concern the device.
fn device_rows() -> BTreeSet<String> {
    let document = concat!(env!("CARGO_MANIFEST_DIR"), "/../../docs/ASSUMPTIONS.md");
    let text = std::fs::read_to_string(document).unwrap();
    let row = |line: &str| {
        let row = line.strip_prefix("| ")?.split_once(' ')?.0;
        let number = row.strip_prefix(['H', 'S'])?;
        (number.parse::<u8>().is_ok() && !NOT_OF_THE_DEVICE.contains(&row)).then(|| row.to_owned())
    };
    text.lines().filter_map(row).collect()
}

fn print_decided(name: &str, rows: &BTreeSet<String>, decided: &BTreeSet<String>) {
    println!("{name} decided: {} of {}", rows.intersection(decided).count(), rows.len());
}

/// A switch makes an assumption about the device one that can differ; the other rows are counted, too.
#[test]
fn nine_of_ten_device_assumptions_are_decided() {
    let findings = probe("");
    let is_decided = |finding: &&Finding| finding.verdict != Verdict::Undecided;
    let rows_of =
        |finding: &Finding| finding.rows.iter().map(|row| (*row).to_owned()).collect::<Vec<_>>();
    let decided: BTreeSet<_> = findings.iter().filter(is_decided).flat_map(rows_of).collect();
    let known: BTreeSet<_> = findings.iter().flat_map(rows_of).collect();
    let all = device_rows();
    assert_eq!(known, all, "each row has an experiment or a reason");
    let switched =
        variants().flat_map(|variant| variant.assumptions).map(|row| (*row).to_owned()).collect();
    print_decided("device assumptions with a switch", &switched, &decided);
    print_decided("all device assumptions", &all, &decided);
    for row in all.difference(&decided) {
        let of_row = findings.iter().find(|finding| finding.rows.contains(&row.as_str())).unwrap();
        println!("  {row}: {}", of_row.detail);
    }
    let undecided: Vec<_> = switched.difference(&decided).collect();
    assert!(undecided.len() * 10 <= switched.len(), "{undecided:?}");
}
