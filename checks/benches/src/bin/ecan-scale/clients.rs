//! Time of a cycle with clients of a service that read all frames, on the simulated master in real time.

use std::hint::black_box;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{scope, sleep};
use std::time::{Duration, Instant};

use ecan_bench::measure::{median, rounds};
use ecan_host::AdapterConfig;
use ecan_mcan_port::{ChannelConfig, GatewayConfig, Port, PortConfig};
use ecan_protocol::can::{CanFrame, CanId};
use ecan_service::client::{Client, Subscription};
use ecan_service::server::{ServePort as _, ServiceConfig};
use ecan_sim::{ClockKind, SimOptions};
use ecan_tool_support::plot::{CurvePanel, Series, Tone};

use crate::Fallible;
use crate::page::Section;

const CLIENTS: [usize; 6] = [0, 1, 4, 16, 32, 64];
const FRAMES: u16 = 10;
const PERIOD: Duration = Duration::from_millis(1);
const CYCLES: usize = 3_000;

pub fn section() -> Fallible<Section> {
    let mut points = Vec::new();
    let mut rows = Vec::new();
    for clients in CLIENTS {
        let ns = cycle_ns(clients)?;
        points.push((clients as f64, Some(ns / 1e3)));
        rows.push(vec![clients.to_string(), format!("{:.2}", ns / 1e3)]);
    }
    let panel = CurvePanel {
        y_label: "time in a cycle, median [us]".to_owned(),
        series: vec![Series { name: "measured".to_owned(), tone: Tone::Actual, points }],
        ..CurvePanel::default()
    };
    let header = ["clients that read all frames", "cycle on the simulated master, median, us"];
    Ok(Section {
        name: "clients",
        title: "Service: time of a cycle with clients, 10 frames each way",
        x_label: "clients",
        panels: vec![panel],
        is_simulated: true,
        header: header.map(str::to_owned).into(),
        rows,
    })
}

/// Median time from the begin to the end of a cycle.
fn cycle_ns(clients: usize) -> Fallible<f64> {
    let options = SimOptions { clock: Some(ClockKind::Real), ..SimOptions::default() };
    let backend = ecan_sim::open_scenario(ecan_sim::echo(1), &options)?;
    let gateway = GatewayConfig::on_all_channels(ChannelConfig::classic(1_000_000));
    let adapter = AdapterConfig::new(1).with_cycle(PERIOD);
    let mut port = Port::open(&backend.ecrt, (adapter, PortConfig::uniform(1, gateway)))?;
    port.wait_ready()?;
    let directory = tempfile::tempdir()?;
    let path = directory.path().join("scale.sock");
    let service =
        port.serve(ServiceConfig { max_clients: clients + 1, ..ServiceConfig::new(&path) })?;
    let is_over = AtomicBool::new(false);
    let frame = |n| CanFrame::classic(CanId::standard(0x100 + n)?, &[0; 8]);
    let frames = (0..FRAMES).map(frame).collect::<Result<Vec<_>, _>>()?;
    let mut times = Vec::with_capacity(CYCLES);
    scope(|threads| -> Fallible<()> {
        for _ in 0..clients {
            let client = Client::connect(&path, "reader")?;
            client.subscribe(&Subscription::default())?;
            let is_over = &is_over;
            threads.spawn(move || {
                while !is_over.load(Ordering::Acquire) && client.poll(100 * PERIOD).is_ok() {}
            });
        }
        let mut next = Instant::now();
        for _ in 0..rounds(CYCLES) {
            next = Instant::now().max(next + PERIOD);
            sleep(next.saturating_duration_since(Instant::now()));
            let start = Instant::now();
            let mut cycle = port.begin_cycle();
            for item in cycle.received() {
                black_box(item);
            }
            for (number, frame) in (0..).zip(&frames) {
                let channel = cycle.channel(0, number % 4)?;
                // A full bus may reject some.
                let _ = cycle.send(channel, frame);
            }
            let _ = cycle.finish();
            times.push(start.elapsed().as_nanos() as f64);
        }
        is_over.store(true, Ordering::Release);
        Ok(())
    })?;
    drop(service);
    Ok(median(times))
}
