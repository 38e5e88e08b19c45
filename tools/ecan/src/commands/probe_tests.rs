//! Restoring, with the gateway's memory in view.

use super::*;
use ecan_sim::ClockKind;
use ecan_sim::SimOptions;

fn bus() -> Bus {
    let options = SimOptions { clock: Some(ClockKind::Stepped), ..SimOptions::default() };
    let backend = ecan_sim::open_scenario(ecan_sim::echo(1), &options).unwrap();
    Bus::over(&backend.ecrt)
}

fn request() -> Request {
    Request { master: 0, wired: None, read_only: false, timing: CycleTiming::default() }
}

/// Every setting of the gateway, with what is active.
fn everything(bus: &Bus) -> String {
    format!("{:?}", Saved::read(bus, 0).unwrap())
}

/// Channel 1 active, other values not applied.
fn configure(bus: &Bus) {
    for (index, subindex, value) in [(0x8002, 19, 800_000), (0x8002, 1, 1), (0x8003, 36, 2)] {
        bus.write(0, index, subindex, value).unwrap();
    }
}

fn of_verdict(report: &ProbeReport, verdict: Verdict) -> usize {
    report.findings.iter().filter(|finding| finding.verdict == verdict).count()
}

#[test]
fn configuration_is_restored() {
    for is_configured in [false, true] {
        let bus = bus();
        if is_configured {
            configure(&bus);
        }
        let before = everything(&bus);
        let report = probe_and_restore(&bus, 0, &request(), &Interrupt::default(), |_| ()).unwrap();
        assert_eq!(of_verdict(&report, Verdict::Differs), 0, "{:#?}", report.findings);
        assert!(report.is_restored, "{}", report.configuration);
        assert_eq!(everything(&bus), before);
    }
}

#[test]
fn stopped_probe_restores_at_every_experiment() {
    let count = ecan_tool_support::probe::experiments().count();
    for stopped_at in (0..count).step_by(5) {
        let bus = bus();
        configure(&bus);
        let before = everything(&bus);
        let interrupt = Interrupt::default();
        let mut begun = 0;
        let stop = |_: &Experiment| {
            if begun == stopped_at {
                interrupt.request();
            }
            begun += 1;
        };
        let report = probe_and_restore(&bus, 0, &request(), &interrupt, stop).unwrap();
        assert!(report.was_stopped && report.is_restored, "{}", report.configuration);
        let stopped =
            report.findings.iter().filter(|finding| finding.detail == "stopped before the end");
        assert_eq!(stopped.count(), count - stopped_at);
        assert_eq!(everything(&bus), before, "stopped at {stopped_at}");
    }
}

#[test]
fn read_only_probe_changes_nothing() {
    let bus = bus();
    configure(&bus);
    let before = everything(&bus);
    let request = Request { read_only: true, ..request() };
    let report = probe_and_restore(&bus, 0, &request, &Interrupt::default(), |_| ()).unwrap();
    assert_eq!(report.configuration, "not changed");
    assert!(of_verdict(&report, Verdict::Holds) > 0);
    let others = report.findings.iter().filter(|finding| finding.stage > Some(Stage::Reading));
    assert!(others.clone().all(|other| other.detail == "not run with --read-only"));
    assert_eq!(everything(&bus), before);
}
