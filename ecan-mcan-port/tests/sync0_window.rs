//! A Sync0 shift among the arrivals of the outputs costs working counters and OP (manual 16.1).

use std::time::Duration;

use crate::common::{Fixture, Handles, classic, frame};
use ecan_host::{AdapterConfig, DcSync};
use ecan_mcan_port::{GatewayConfig, PortConfig};
use ecan_protocol::device::AlStatusCode;
use ecan_sim::{Scenario, Sync0Window};

const GATEWAYS: usize = 3;

/// Three gateways with N = 3 at 1 ms.
fn open(shift_us: u64, scenario: Scenario) -> Fixture {
    let mut adapter = AdapterConfig::new(GATEWAYS as u16).with_cycle(Duration::from_millis(1));
    adapter.dc = Some(DcSync::new(adapter.cycle, Duration::from_micros(shift_us)));
    let config = PortConfig::uniform(GATEWAYS, GatewayConfig::on_channel(0, classic()));
    Fixture::open(scenario, adapter, config).unwrap_or_else(|e| panic!("{e}"))
}

/// What the host and the gateways have counted so far, over all gateways.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Effects {
    incomplete_cycles: u64,
    outputs_missed: u64,
    left_op: u64,
}

fn effects(fixture: &Fixture) -> Effects {
    let port = &fixture.port;
    let incomplete = |gateway| port.statistics(port.gw(gateway)).incomplete_cycles;
    let counters =
        |gateway| fixture.simulation.with_world(|world| world.counters(gateway).unwrap());
    Effects {
        incomplete_cycles: (0..GATEWAYS).map(incomplete).sum(),
        outputs_missed: (0..GATEWAYS).map(|gateway| counters(gateway).outputs_missed).sum(),
        left_op: (0..GATEWAYS).map(|gateway| counters(gateway).al_errors).sum(),
    }
}

#[test]
fn shifts_outside_the_arrivals_run_undisturbed() {
    for shift_us in [0, 300, 500, 700, 800, 950] {
        let mut fixture = open(shift_us, ecan_sim::echo(GATEWAYS));
        fixture.port.wait_ready().unwrap_or_else(|e| panic!("{shift_us} us: {e}"));
        let before = effects(&fixture);
        fixture.idle(1_000);
        assert_eq!(effects(&fixture), before, "{shift_us} us");
        assert_eq!(fixture.carry(0, &[frame(1, &[]), frame(2, &[])], 20).len(), 2);
    }
}

#[test]
fn shifts_among_the_arrivals_lose_op_with_the_code() {
    for (shift_us, code) in [
        (70, AlStatusCode::SYNC_ERROR),
        (100, AlStatusCode::FATAL_SYNC),
        (150, AlStatusCode::SYNC_ERROR),
        (200, AlStatusCode::SYNC_ERROR),
    ] {
        let mut scenario = ecan_sim::echo(GATEWAYS);
        for gateway in &mut scenario.gateways {
            gateway.config.sync0_window = Sync0Window { al_status: code, ..Sync0Window::default() };
        }
        let mut fixture = open(shift_us, scenario);
        // A gateway may be ready for the ten cycles until it leaves OP.
        let _ = fixture.port.wait_ready_timeout(Duration::from_secs(5));
        let has_code = |fixture: &Fixture| {
            fixture.simulation.with_world(|world| {
                (0..GATEWAYS).any(|at| world.gateway(at).unwrap().al_status_code() == code.0)
            })
        };
        let is_code_seen = (0..4_000).any(|_| {
            fixture.idle(1);
            has_code(&fixture)
        });
        let effects = effects(&fixture);
        assert!(effects.outputs_missed > 0 && effects.left_op > 0, "{shift_us} us: {effects:?}");
        assert!(is_code_seen, "{shift_us} us");
    }
}

/// Without the limit OP is kept: working counters are missing, and no frame is lost or doubled.
#[test]
fn missed_outputs_neither_lose_nor_double_frames() {
    let mut scenario = ecan_sim::echo(GATEWAYS);
    for gateway in &mut scenario.gateways {
        gateway.config.sync0_window = Sync0Window { missed_limit: 0, ..Sync0Window::default() };
    }
    let mut fixture = open(100, scenario);
    fixture.port.wait_ready().unwrap();
    let before = effects(&fixture);
    let frames: Vec<_> = (1..=100).map(|id| frame(id, &[])).collect();
    let back: Vec<_> = fixture.carry(0, &frames, 2_000).iter().map(|f| f.frame.id()).collect();
    assert_eq!(back, frames.iter().map(|frame| frame.id()).collect::<Vec<_>>());
    let after = effects(&fixture);
    assert!(after.incomplete_cycles > before.incomplete_cycles + 10, "{after:?}");
    assert_eq!(after.left_op, before.left_op);
}
