//! Gateways whose results or objects differ from what the account of scheduled frames assumes: frames stay
//! unknown for a stated reason, and what the reason proposes helps.

use crate::common::{Fixture, Handles, with_sync0};
use crate::schedule_support::{OFFSET_NS, SHIFT_NS, check, results, schedule};
use ecan_mcan_port::{GatewayConfig, ScheduleDiagnostics, ScheduleFault};
use ecan_sim::variant::{GatewayVariant, LateResult};
use ecan_sim::{Fault, GatewayFault, Scenario, echo};

fn gateway(variant: GatewayVariant) -> Scenario {
    let mut scenario = echo(1);
    scenario.gateways[0].config.variant = variant;
    scenario
}

fn stall(fixture: &mut Fixture) {
    let fault = GatewayFault::ServiceStall { ms: 2 };
    fixture.simulation.inject(Fault::Gateway { gateway: 0, fault });
}

/// 200 cycles with three frames each; in one of them the firmware is too late.
fn run_stalled(scenario: Scenario, change: fn(&mut GatewayConfig)) -> Fixture {
    let mut fixture = with_sync0(scenario, SHIFT_NS, change);
    for nth in 0..200 {
        if nth == 120 {
            stall(&mut fixture);
        }
        schedule(&mut fixture, 3, OFFSET_NS);
    }
    fixture
}

fn fault(fixture: &Fixture) -> Option<ScheduleFault> {
    fixture.port.schedule_fault(fixture.port.gw(0))
}

/// A late frame must not count as sent, whatever its result.
#[test]
fn no_result_of_a_late_frame_counts_it_as_sent() {
    for late_result in [LateResult::Absent, LateResult::Queued, LateResult::BusBusy] {
        let variant = GatewayVariant { late_result, ..GatewayVariant::default() };
        let mut fixture = run_stalled(gateway(variant), results);
        let (frames, counters) = check(&mut fixture);
        let late = counters.transmit_losses.late;
        assert!(late > 0 && frames.sent > 300, "{late_result:?}: {frames:?}");
        assert_eq!(frames.not_sent, if late_result == LateResult::BusBusy { late } else { 0 });
        let flags = ScheduleDiagnostics::LATE_DROP;
        assert_eq!(fault(&fixture), Some(ScheduleFault::Flagged { flags }));
    }
}

#[test]
fn missing_diagnostics_end_frames_as_unknown() {
    let missing = Scenario::from_toml(
        "[[gateway]]\n[gateway.variant]\nmissing_entries = [\"0x9020\"]\n",
        "missing",
        std::path::Path::new("."),
    )
    .unwrap();
    for change in [results as fn(&mut GatewayConfig), |_| ()] {
        let mut fixture = run_stalled(missing.clone(), change);
        let (frames, _) = check(&mut fixture);
        assert_eq!((frames.sent, frames.open), (0, 0));
        assert_eq!(
            fault(&fixture),
            Some(ScheduleFault::Unreadable { index: 0x9020, subindex: 12 })
        );
    }
}
