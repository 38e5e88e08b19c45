//! Results of scheduled frames while the master reads the flags at the pace of IgH 1.6.2
//! (manual 13.7).

use std::time::Duration;

use crate::common::{Fixture, Handles, classic};
use crate::schedule_support::{OFFSET_NS, SHIFT_NS, account, check, results, schedule};
use ecan_host::{AdapterConfig, DcSync};
use ecan_mcan_port::{GatewayConfig, PortConfig};
use ecan_sim::MasterBehaviour;

/// Sync0 and cycle have this period.
fn at_pace_of_igh(cycle: Duration) -> Fixture {
    let mut scenario = ecan_sim::echo(1);
    scenario.master = MasterBehaviour::IGH;
    let mut adapter = AdapterConfig::new(1).with_cycle(cycle);
    adapter.dc = Some(DcSync::new(cycle, Duration::from_nanos(SHIFT_NS.into())));
    let mut gateway = GatewayConfig::on_channel(0, classic());
    results(&mut gateway);
    Fixture::ready(scenario, adapter, PortConfig::uniform(1, gateway))
}

#[test]
fn frames_are_proven_within_few_cycles() {
    for (cycle_ms, limit) in [(1, 150), (4, 110)] {
        let mut fixture = at_pace_of_igh(Duration::from_millis(cycle_ms));
        let channel = fixture.port.ch(0, 0);
        for _ in 0..5 {
            for _ in 0..100 {
                assert_eq!(schedule(&mut fixture, 1, OFFSET_NS), 1);
            }
            let cycles = fixture.until(limit, |port| port.schedule_account(channel).open == 0);
            assert!(cycles.is_some(), "{cycle_ms} ms: {:?}", account(&fixture));
        }
        let (frames, _) = check(&mut fixture);
        assert_eq!((frames.sent, frames.unknown), (500, 0));
        let diagnostics = fixture.port.schedule_diagnostics(fixture.port.gw(0)).unwrap();
        assert!(diagnostics.sync0_count > 0 && diagnostics.service_max_cycles > 0);
    }
}

#[test]
fn clears_do_not_prevent_proof() {
    for cycle_ms in [1, 4] {
        let mut fixture = at_pace_of_igh(Duration::from_millis(cycle_ms));
        for nth in 0..1_000 {
            schedule(&mut fixture, 1, OFFSET_NS);
            if nth % 100 == 10 {
                fixture.port.clear_schedule_flags(fixture.port.gw(0));
            }
        }
        let (frames, _) = check(&mut fixture);
        assert!(3 * frames.sent > frames.scheduled, "{cycle_ms} ms: {frames:?}");
    }
}
