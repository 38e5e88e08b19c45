//! Time from the send of a cycle to the return of its last frame, by the number of gateways.

use std::time::Duration;

use ecan_host::{AdapterConfig, Plan};
use ecan_mcan_port::{ChannelConfig, GatewayConfig, Port, PortConfig};
use ecan_sim::{ClockKind, SimOptions};

use crate::Fallible;
use crate::page::{Section, compared};

const MULTIPLIERS: [u8; 2] = [3, 11];
const GATEWAYS: [u16; 6] = [1, 2, 4, 8, 12, 16];
const CYCLE: Duration = Duration::from_millis(20);

pub fn section() -> Fallible<Section> {
    let mut rows = Vec::new();
    let mut panels = Vec::new();
    for multiplier in MULTIPLIERS {
        let (mut planned, mut measured) = (Vec::new(), Vec::new());
        for gateways in GATEWAYS {
            let adapter =
                AdapterConfig::new(gateways).with_multiplier(multiplier).with_cycle(CYCLE);
            let plan = Plan::of(&adapter);
            let us = |ns: u64| ns as f64 / 1e3;
            let (by_plan, by_run) = (us(plan.response_ns()), us(response_ns(adapter)?));
            planned.push((gateways.into(), by_plan));
            measured.push((gateways.into(), by_run));
            rows.push(vec![
                multiplier.to_string(),
                gateways.to_string(),
                plan.wire_bytes().to_string(),
                format!("{by_plan:.0}"),
                format!("{by_run:.0}"),
                format!("{:.2}", us(plan.wire_ns()) / 800.0),
            ]);
        }
        let run = ("simulator", measured);
        panels.push(compared(format!("N = {multiplier}"), "response [us]", planned, run));
    }
    let header = [
        "N",
        "gateways",
        "bytes on the wire",
        "response by the planner, us",
        "in the simulator, us",
        "cycle of which the wire takes 80 %, ms",
    ];
    Ok(Section {
        name: "wire",
        title: "EtherCAT: time until the last frame of a cycle returns",
        x_label: "gateways",
        panels,
        is_simulated: true,
        header: header.map(str::to_owned).into(),
        rows,
    })
}

/// Shortest time after the send at which every working counter is complete.
fn response_ns(adapter: AdapterConfig) -> Fallible<u64> {
    let gateways = adapter.slaves.len();
    let options = SimOptions { clock: Some(ClockKind::Stepped), ..SimOptions::default() };
    let backend = ecan_sim::open_scenario(ecan_sim::echo(gateways), &options)?;
    let gateway = GatewayConfig::on_all_channels(ChannelConfig::classic(1_000_000));
    let config = PortConfig::uniform(gateways, gateway);
    let mut port = Port::open(&backend.ecrt, (adapter, config))?;
    port.wait_ready()?;
    let clock = backend.ecrt.clock().clone();
    let (mut too_short, mut enough) = (0, CYCLE.as_nanos() as u64 / 2);
    while enough - too_short > 100 {
        let middle = too_short.midpoint(enough);
        port.next_cycle().end()?;
        clock.sleep_until_ns(clock.now_ns() + middle);
        let cycle = port.begin_cycle();
        let is_complete =
            cycle.gateways().all(|gateway| cycle.cycle_report(gateway).domain.is_complete());
        let _ = cycle.finish();
        if is_complete {
            enough = middle;
        } else {
            too_short = middle;
        }
        // Nothing is on its way before the next attempt.
        for _ in 0..3 {
            port.next_cycle().end()?;
        }
    }
    Ok(enough)
}
