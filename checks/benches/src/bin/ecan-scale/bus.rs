//! Axes on one CAN channel, by the cycle.

use std::time::Duration;

use ecan_canopen::{NodeAddress, NodeId};
use ecan_cia402::{AxisConfig, AxisRef, Cia402, Cia402Config, axis_traffic};
use ecan_host::AdapterConfig;
use ecan_mcan_port::{ChannelConfig, ChannelLoad, GatewayConfig, Port, PortConfig, Traffic};
use ecan_sim::{ClockKind, SimOptions};
use ecan_tool_support::plot::{CurvePanel, Series, Tone};

use crate::Fallible;
use crate::page::Section;

const CYCLES_MS: [u64; 3] = [1, 2, 4];
const MOST_AXES: u8 = 8;
const BITRATE: u32 = 1_000_000;
/// Time in which every axis must follow its targets without a hold.
const RUN: Duration = Duration::from_secs(2);

pub fn section() -> Fallible<Section> {
    let mut rows = Vec::new();
    let mut panels = Vec::new();
    for cycle_ms in CYCLES_MS {
        let (mut least, mut most, mut run) = (Vec::new(), Vec::new(), Vec::new());
        for axes in 1..=MOST_AXES {
            let cycle = Duration::from_millis(cycle_ms);
            let config: Vec<AxisConfig> = (1..=axes).map(axis).collect();
            let load = load(&config, cycle);
            let runs = follows(config, cycle)?;
            let percent = |share: f64| 100.0 * share;
            least.push((f64::from(axes), Some(percent(load.least))));
            most.push((f64::from(axes), Some(percent(load.most))));
            run.push((f64::from(axes), runs.then_some(percent(load.least.midpoint(load.most)))));
            rows.push(vec![
                cycle_ms.to_string(),
                axes.to_string(),
                format!("{:.0} to {:.0} %", percent(load.least), percent(load.most)),
                load.peak_sent.max(load.peak_received).to_string(),
                if runs { "all follow" } else { "axes hold" }.to_owned(),
            ]);
        }
        // The curve of the runs ends there.
        let hold = run.iter().find(|(_, percent)| percent.is_none());
        let hold = hold
            .map_or(String::new(), |(axes, _)| format!(": axes hold if there are {axes} or more"));
        let series = |name: &str, tone, points| Series { name: name.to_owned(), tone, points };
        panels.push(CurvePanel {
            title: format!("cycle of {cycle_ms} ms{hold}"),
            y_label: "load of the bus [%]".to_owned(),
            series: vec![
                series("without stuff bits", Tone::Difference, least),
                series("with all stuff bits", Tone::Target, most),
                series("runs in the simulator", Tone::Actual, run),
            ],
            ..CurvePanel::default()
        });
    }
    let header = [
        "cycle, ms",
        "axes of a channel",
        "load of the bus by the planner",
        "frames of a cycle in one direction",
        "in the simulator",
    ];
    Ok(Section {
        name: "bus",
        title: "CAN: CSP axes on one channel at 1 Mbit/s, targets in every cycle",
        x_label: "axes of a channel",
        panels,
        is_simulated: true,
        header: header.map(str::to_owned).into(),
        rows,
    })
}

fn axis(number: u8) -> AxisConfig {
    let node = NodeId::new(number).expect("1 to 8");
    AxisConfig::new(NodeAddress { slave: 0, channel: 0, node })
}

fn load(axes: &[AxisConfig], cycle: Duration) -> ChannelLoad {
    let traffic = axis_traffic(axes, &Cia402Config::default());
    ChannelLoad::of(&traffic, &ChannelConfig::classic(BITRATE).can, cycle.as_nanos() as u32)
}

/// Returns whether all axes follow targets for the whole time.
fn follows(axes: Vec<AxisConfig>, cycle: Duration) -> Fallible<bool> {
    let options = SimOptions { clock: Some(ClockKind::Stepped), ..SimOptions::default() };
    let backend = ecan_sim::open_scenario(ecan_sim::drives(1, MOST_AXES), &options)?;
    let frames = (axes.len() as u8 + 1).min(8);
    let channel =
        ChannelConfig::classic(BITRATE).with_traffic(Traffic { received: frames, sent: frames });
    let adapter = AdapterConfig::new(1).with_cycle(cycle);
    let config = PortConfig::uniform(1, GatewayConfig::on_channel(0, channel));
    let mut port = Port::open(&backend.ecrt, (adapter, config))?;
    port.wait_ready()?;
    let count = axes.len();
    let mut cia402 = Cia402::new(&port, axes, Cia402Config::default())?;
    if cia402.blocking(&mut port, Duration::from_secs(20)).start_up().is_err() {
        return Ok(false);
    }
    let cycles = RUN.as_nanos() / cycle.as_nanos();
    let mut is_direct = true;
    for number in 0..cycles {
        if number % 200 == 0 {
            is_direct = !is_direct;
        }
        let mut open = port.next_cycle();
        cia402.process_rx(&mut open);
        for axis in 0..count {
            let step = if is_direct { 5 } else { -5 };
            if let Some(target) = cia402.axis(axis).and_then(AxisRef::target) {
                cia402.axis_mut(axis)?.set_target(target + step)?;
            }
        }
        cia402.send_targets_all(&mut open);
        open.end()?;
        if !cia402.all_running() {
            return Ok(false);
        }
    }
    Ok(true)
}
