//! Lost links during experiments.

use ecan_sim::{ClockKind, Fault, SimOptions};
use ecan_tool_support::probe::{Finding, Probe, ProbeOptions, Verdict, experiments};

/// Runs the probe; the link is lost for this time when an experiment begins.
fn probe(lost_at: usize, for_ms: u32) -> Vec<Finding> {
    let options = SimOptions { clock: Some(ClockKind::Stepped), ..SimOptions::default() };
    let backend = ecan_sim::open_scenario(ecan_sim::echo(1), &options).unwrap();
    let simulation = backend.simulation.unwrap();
    let mut probe = Probe::open(&backend.ecrt, 0, 0, ProbeOptions::default()).unwrap();
    let mut begun = 0;
    probe.run(|_| {
        if begun == lost_at {
            simulation.inject(Fault::LinkLoss { gateway: 0, for_ms });
        }
        begun += 1;
    })
}

fn decided(findings: &[Finding]) -> usize {
    findings.iter().filter(|finding| finding.verdict != Verdict::Undecided).count()
}

#[test]
fn interrupted_experiment_is_repeated() {
    let undisturbed = decided(&probe(usize::MAX, 0));
    for lost_at in 0..experiments().count() {
        let findings = probe(lost_at, 1_500);
        let different: Vec<_> =
            findings.iter().filter(|finding| finding.verdict == Verdict::Differs).collect();
        assert!(different.is_empty(), "lost at {lost_at}: {different:?}");
        assert!(decided(&findings) + 1 >= undisturbed, "lost at {lost_at}: {findings:#?}");
    }
}

#[test]
fn lost_gateway_leaves_the_rest_undecided() {
    let lost_at = experiments().count() / 2;
    let findings = probe(lost_at, u32::MAX);
    let (before, after) = findings.split_at(lost_at);
    let undisturbed = probe(usize::MAX, 0);
    assert_eq!(decided(before), decided(&undisturbed[..lost_at]));
    assert_eq!(decided(after), 0);
    let lost = after
        .iter()
        .filter(|finding| finding.detail == "process data or the link to the gateway were lost");
    assert!(lost.count() > 10, "{after:#?}");
}
