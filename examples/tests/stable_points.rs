//! The stable points of manual 15.6.1 beside the usable shifts of the simulator, as in docs/SYNC0.md.
#![allow(missing_docs)]

use std::time::Duration;

#[path = "../../ecan-mcan-port/tests/common/mod.rs"]
mod common;

use common::{Fixture, Handles, SendData, classic, id};
use ecan_example_support::phase_sweep::{PhaseSweep, PhaseSweepError, sweep_phase};
use ecan_example_support::shift_windows::ShiftWindows;
use ecan_host::{AdapterConfig, DcSync, Plan};
use ecan_mcan_port::{GatewayConfig, Port, PortConfig, PortError};
use ecan_protocol::image::{OptionFlags, Schedule};
use ecan_protocol::mapping::CHUNK_BYTES;

const DOCUMENT: &str = include_str!("../../docs/SYNC0.md");
const GATEWAYS: usize = 3;
/// Distance of the tested shifts, in microseconds; the points of the manual come in addition.
const STEP_US: u32 = 50;

fn adapter(cycle_ms: u32, multiplier: u8) -> AdapterConfig {
    AdapterConfig::new(GATEWAYS as u16)
        .with_multiplier(multiplier)
        .with_cycle(Duration::from_millis(cycle_ms.into()))
}

fn ready(adapter: AdapterConfig) -> Fixture {
    let mut gateway = GatewayConfig::on_channel(0, classic());
    gateway.tx_options = OptionFlags::TX_RESULT;
    let config = PortConfig::uniform(GATEWAYS, gateway);
    let mut scenario = ecan_sim::echo(GATEWAYS);
    for gateway in &mut scenario.gateways {
        // Missed outputs show in the working counter; the loss of OP would only take longer.
        gateway.config.sync0_window.missed_limit = 0;
    }
    Fixture::ready(scenario, adapter, config)
}

/// One cycle with a scheduled frame for each gateway.
fn cycle(port: &mut Port, offset_ns: u32) -> Result<(), PhaseSweepError> {
    let mut cycle = port.begin_cycle();
    cycle.received().for_each(drop);
    for slave in 0..GATEWAYS {
        // The account contains rejected frames.
        let _ = cycle.schedule_can(slave, 0, id(1), &[], Schedule { tag: 0, offset_ns });
    }
    cycle.end().map_err(PortError::from)?;
    Ok(())
}

/// Row of the document from the mode to the shifts of the plan.
fn row(cycle_ms: u32, multiplier: u8, manual_us: &[u32]) -> String {
    let mut adapter = adapter(cycle_ms, multiplier);
    adapter.dc = Some(DcSync::planned(adapter.cycle, &adapter));
    let planned = Plan::of(&adapter).output_arrivals().unwrap().usable_shifts_ns().unwrap();
    let mut fixture = ready(adapter);
    let period_us = cycle_ms * 1_000;
    let mut shifts_us: Vec<u32> = (0..period_us).step_by(STEP_US as usize).collect();
    shifts_us.extend(manual_us);
    shifts_us.sort_unstable();
    shifts_us.dedup();
    let sweep = PhaseSweep {
        shifts_ns: shifts_us.iter().map(|us| us * 1_000).collect(),
        offsets_ns: vec![100_000],
        cycles: 60,
    };
    let table = sweep_phase(&mut fixture.port, &sweep, cycle, |_| ()).unwrap();
    for us in manual_us {
        let point = table.points.iter().find(|point| point.shift_ns == us * 1_000).unwrap();
        assert!(table.is_good(point), "N = {multiplier}, {us} us:\n{table}");
    }
    let pdo_bytes = usize::from(multiplier) * CHUNK_BYTES;
    let windows = ShiftWindows::new(&table, pdo_bytes, Some(planned));
    let manual: Vec<String> = manual_us.iter().map(|us| format!("{us} us")).collect();
    format!(
        "| DC Sync0 | {cycle_ms} ms | {pdo_bytes}B | {} | {} | {} to {} us |",
        manual.join(", "),
        windows.text(),
        planned.0 / 1_000,
        planned.1 / 1_000
    )
}

#[test]
fn stable_points_of_sync0_are_usable_in_the_simulator() {
    let rows = [
        row(1, 3, &[700, 800]),
        row(1, 4, &[0]),
        row(1, 5, &[450, 650, 800]),
        row(2, 6, &[600]),
        row(2, 10, &[1600]),
    ];
    for row in &rows {
        assert!(DOCUMENT.contains(row), "docs/SYNC0.md needs these rows:\n{}", rows.join("\n"));
    }
}

#[test]
fn stable_points_without_sync0_run_in_the_simulator() {
    for (cycle_ms, multipliers) in [(1, &[3, 4, 5][..]), (2, &[6, 10])] {
        for multiplier in multipliers {
            let mut fixture = ready(adapter(cycle_ms, *multiplier));
            let incomplete = |fixture: &Fixture| -> u64 {
                let of = |slave| fixture.port.statistics(fixture.port.gw(slave)).incomplete_cycles;
                (0..GATEWAYS).map(of).sum()
            };
            let before = incomplete(&fixture);
            fixture.idle(500);
            assert_eq!(incomplete(&fixture), before, "N = {multiplier}");
        }
    }
}
