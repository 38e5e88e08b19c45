//! Processor time of a cycle of 1 ms with three gateways and ten axes, as a share of one core.
//!
//! ```text
//! cargo bench -p ecan-cia402 --bench cycle_cpu [-- --ecrt SETTING --cycles N]
//! ```
//!
//! The thread sleeps until each cycle, so that the caches are as cold as in use. The time is the
//! processor time of the thread: receive, axes with a target of the application each, send. The wait,
//! which every program with a cycle has, is measured separately; so are the calls of a library. A master
//! that exchanges nothing has none.
//!
//! Without a setting it measures the null master and, under `cargo bench`, the simulated library in real
//! time. With one it measures that library, for example a real one with `ecan-sim wire --gateways 3 --scenario drives` on its bus.
#![allow(missing_docs)]

use std::time::Duration;

use ecan_bench::measure::{Row, print_rows, rounds, thread_cpu_ns};
use ecan_bench::null_master::LibraryTime;
use ecan_canopen::{NodeAddress, NodeId};
use ecan_cia402::{AxisConfig, AxisRef, Cia402, Cia402Config};
use ecan_host::{
    AdapterConfig, CycleTimer, CycleTiming, Ecrt, EcrtSetting, MonotonicClock, RealTimeConfig,
};
use ecan_mcan_port::{ChannelConfig, GatewayConfig, Port, PortConfig};
use ecan_protocol::image::Header;
use ecan_sim::{ClockKind, SimOptions};

const GATEWAYS: usize = 3;
const AXES: usize = 10;
const MULTIPLIER: u8 = 3;
const CYCLE_NS: u32 = 1_000_000;
const CYCLES: usize = 10_000;
/// Cycles until all TPDOs of a cycle lie in one image of each gateway.
const MOST_CYCLES: usize = 2_000;

struct Bench {
    port: Port,
    cia402: Cia402,
}

impl Bench {
    fn started(ecrt: &Ecrt) -> Self {
        let adapter = AdapterConfig::new(GATEWAYS as u16)
            .with_multiplier(MULTIPLIER)
            .with_cycle(Duration::from_nanos(CYCLE_NS.into()));
        let gateway = GatewayConfig::on_all_channels(ChannelConfig::classic(1_000_000));
        let config = (adapter, PortConfig::uniform(GATEWAYS, gateway));
        let mut port = Port::open(ecrt, config).unwrap();
        port.wait_ready().unwrap();
        let axis = |number: usize| {
            AxisConfig::new(NodeAddress {
                slave: number % GATEWAYS,
                channel: (number / GATEWAYS) as u8,
                node: NodeId::new(1).unwrap(),
            })
        };
        let axes = (0..AXES).map(axis).collect();
        let mut cia402 = Cia402::new(&port, axes, Cia402Config::default()).unwrap();
        cia402.blocking(&mut port, Duration::from_secs(30)).start_up().unwrap();
        Self { port, cia402 }
    }

    /// A cycle after the wait; returns the number of targets sent.
    fn cycle(&mut self) -> usize {
        let mut cycle = self.port.begin_cycle();
        self.cia402.process_rx(&mut cycle);
        for axis in 0..AXES {
            let target = self.cia402.axis(axis).and_then(AxisRef::target).unwrap();
            self.cia402.axis_mut(axis).unwrap().set_target(target).unwrap();
        }
        let summary = self.cia402.send_targets_all(&mut cycle);
        // A library may lose a frame, which the next cycle repeats.
        let _ = cycle.end();
        summary.targets
    }

    /// Runs to a cycle in whose images every axis has its TPDO, and keeps these images.
    fn keep_full_cycle(&mut self) {
        for _ in 0..MOST_CYCLES {
            self.port.wait_next_cycle();
            self.cycle();
            let frames = |slave| {
                let image: &[u8] = self.port.adapter().tx_pdo(slave);
                image.first_chunk().map_or(0, |header| Header::parse(header).frame_count.into())
            };
            if (0..GATEWAYS).all(|slave| frames(slave) == (AXES - slave).div_ceil(GATEWAYS)) {
                for slave in 0..GATEWAYS {
                    ecan_bench::null_master::keep_new(self.port.adapter().tx_pdo(slave));
                }
                return;
            }
        }
        panic!("the axes never had all their TPDOs in one cycle");
    }

    fn received(&self) -> u64 {
        self.cia402.axes().map(|axis| axis.statistics().tpdos).sum()
    }
}

/// Processor time of each cycle, ns.
#[derive(Default)]
struct Times(Vec<f64>);

impl Times {
    fn share(&self, quantile: f64) -> f64 {
        let mut times = self.0.clone();
        times.sort_by(f64::total_cmp);
        let index = (times.len() as f64 * quantile) as usize;
        times.get(index).map_or(f64::NAN, |ns| ns / f64::from(CYCLE_NS))
    }

    fn print(&self, name: &str) {
        let mean = self.0.iter().sum::<f64>() / self.0.len() as f64 / f64::from(CYCLE_NS);
        let [mean, p50, p99] = [mean, self.share(0.5), self.share(0.99)].map(|share| share * 100.0);
        println!("{name:45} mean {mean:6.2} %  p50 {p50:6.2} %  p99 {p99:6.2} %");
    }

    fn rows(&self, name: &str) -> [Row; 2] {
        let row = |text: &str, quantile| {
            let measure = format!("CPU of a 1 ms cycle, 3 gateways, 10 axes, {name}, {text}");
            let what = "cycle without the wait and the calls of the library / one core";
            Row::new(measure, what, self.share(quantile)).as_share()
        };
        [row("p50", 0.5).with_goals(0.01, 0.01), row("p99", 0.99)]
    }
}

/// On a master that exchanges nothing: without calls of a library.
fn null_master() -> [Row; 2] {
    let ecrt = ecan_bench::null_master::open(ecan_sim::drives(GATEWAYS, 1)).unwrap();
    let mut bench = Bench::started(&ecrt);
    bench.keep_full_cycle();
    ecan_bench::null_master::freeze();
    let mut timer = CycleTimer::new(CYCLE_NS, CycleTiming::default());
    let (mut waits, mut works, mut warm) = (Times::default(), Times::default(), Times::default());
    let (before, mut targets) = (bench.received(), 0);
    for _ in 0..cycles() {
        let start_ns = thread_cpu_ns();
        timer.wait(&MonotonicClock);
        let woken_ns = thread_cpu_ns();
        targets += bench.cycle();
        let end_ns = thread_cpu_ns();
        waits.0.push((woken_ns - start_ns) as f64);
        works.0.push((end_ns - woken_ns) as f64);
    }
    for _ in 0..cycles() {
        let start_ns = thread_cpu_ns();
        targets += bench.cycle();
        warm.0.push((thread_cpu_ns() - start_ns) as f64);
    }
    // Every axis followed targets and got its TPDO throughout.
    assert_eq!(targets, 2 * cycles() * AXES);
    assert_eq!(bench.received() - before, targets as u64);
    waits.print("null master, wait");
    works.print("null master, cycle");
    warm.print("null master, cycle, without waits between");
    works.rows("null master")
}

/// On a library, whose calls are timed.
fn library(name: &str, ecrt: &Ecrt) -> [Row; 2] {
    let mut bench = Bench::started(&ecan_bench::null_master::timed(ecrt));
    let cost_ns = LibraryTime::cost_ns();
    let (mut waits, mut calls, mut works) = (Times::default(), Times::default(), Times::default());
    let (before, mut targets) = (bench.received(), 0);
    for _ in 0..cycles() {
        let start_ns = thread_cpu_ns();
        bench.port.wait_next_cycle();
        let (woken_ns, calls_before) = (thread_cpu_ns(), LibraryTime::now());
        targets += bench.cycle();
        let (end_ns, calls_after) = (thread_cpu_ns(), LibraryTime::now());
        let calls_ns = (calls_after.ns - calls_before.ns) as f64;
        let measuring_ns = (calls_after.calls - calls_before.calls) as f64 * cost_ns;
        waits.0.push((woken_ns - start_ns) as f64);
        calls.0.push(calls_ns);
        works.0.push((end_ns - woken_ns) as f64 - measuring_ns - calls_ns);
    }
    // A thread that is late by cycles makes axes hold.
    let expected = cycles() * AXES;
    let received = bench.received() - before;
    assert!(received as usize > expected / 2, "{received} of {expected} TPDOs");
    println!("{name}: {targets} of {expected} targets, {received} TPDOs");
    waits.print(&format!("{name}, wait"));
    calls.print(&format!("{name}, calls of the library"));
    works.print(&format!("{name}, cycle without these calls"));
    works.rows(name)
}

/// The value after this option.
fn argument(option: &str) -> Option<String> {
    std::env::args().skip_while(|argument| argument != option).nth(1)
}

fn cycles() -> usize {
    let cycles = argument("--cycles").map(|text| text.parse().expect("--cycles: a number"));
    cycles.unwrap_or_else(|| rounds(CYCLES))
}

fn main() {
    let options = SimOptions { clock: Some(ClockKind::Real), ..SimOptions::default() };
    // Without the permission other load may delay the thread by more than gateways and drives allow.
    let settings = RealTimeConfig { priority: Some(80), ..RealTimeConfig::default() };
    eprint!("{}", settings.apply().expect("nothing is required"));
    println!("processor time of the thread in a cycle of 1 ms, share of one core");
    let rows = match argument("--ecrt") {
        Some(setting) => {
            let setting = EcrtSetting::parse(&setting);
            let ecrt = ecan_sim::open(&setting, &options).unwrap().ecrt;
            library("library", &ecrt).to_vec()
        }
        None if !std::env::args().any(|argument| argument == "--bench") => null_master().to_vec(),
        None => {
            let ecrt =
                ecan_sim::open_scenario(ecan_sim::drives(GATEWAYS, 1), &options).unwrap().ecrt;
            let simulated = library("simulated library", &ecrt);
            [null_master(), simulated].concat()
        }
    };
    print_rows(&rows);
}
