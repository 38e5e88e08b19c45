//! Run time of the cycle of a Port whose service has clients, relative to a Port without a service.
//!
//! ```text
//! cargo bench -p ecan-bench --bench clients
//! ```
//!
//! Both Ports are on a master of the same kind: one that exchanges nothing, and the simulated one in real
//! time, with echo nodes. One cycle per millisecond runs, of each Port in turn, so that both find the
//! caches as after a wait. Six clients read all frames, one polls the state, and one never reads.
#![allow(missing_docs)]

use std::hint::black_box;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{Scope, scope, sleep};
use std::time::{Duration, Instant};

use ecan_bench::measure::{Row, median, print_rows, rounds};
use ecan_host::{AdapterConfig, Distribution, RealTimeConfig};
use ecan_mcan_port::{ChannelConfig, ChannelHandle, GatewayConfig, Port, PortConfig, ReceivedView};
use ecan_protocol::can::{CanFrame, CanId};
use ecan_protocol::image::{CommitFields, ImageWriter, Timestamp};
use ecan_protocol::mapping::Direction;
use ecan_service::client::{Client, Subscription};
use ecan_service::server::{ServePort as _, ServiceConfig};
use ecan_sim::{ClockKind, SimOptions, open_scenario};
use ecan_test_support::OnDrop;

const MULTIPLIER: u8 = 3;
/// In each image.
const FRAMES: u8 = 10;
const READERS: usize = 6;
const PERIOD: Duration = Duration::from_millis(1);
/// Cycles of each Port in a segment; a ratio is the median of those of the segments.
const CYCLES: usize = 1000;
const SEGMENTS: usize = 15;

#[derive(Clone, Copy)]
enum Master {
    Null,
    Simulated,
}

struct Side {
    port: Port,
    channels: Vec<ChannelHandle>,
    frames: Vec<CanFrame>,
    times_ns: Vec<u64>,
}

impl Side {
    fn new(master: Master) -> Self {
        let gateway = GatewayConfig {
            paced: false,
            ..GatewayConfig::on_all_channels(ChannelConfig::classic(1_000_000))
        };
        let options = SimOptions { clock: Some(ClockKind::Real), ..SimOptions::default() };
        let ecrt = match master {
            Master::Null => ecan_bench::null_master::open(ecan_sim::echo(1)).unwrap(),
            Master::Simulated => open_scenario(ecan_sim::echo(1), &options).unwrap().ecrt,
        };
        let adapter = AdapterConfig::new(1).with_cycle(PERIOD).with_multiplier(MULTIPLIER);
        let mut port = Port::open(&ecrt, (adapter, PortConfig::uniform(1, gateway))).unwrap();
        port.wait_ready().unwrap();
        let frame = |number| {
            CanFrame::classic(CanId::standard(0x100 + u16::from(number)).unwrap(), &[number; 8])
        };
        let frames: Vec<_> = (0..FRAMES).map(|number| frame(number).unwrap()).collect();
        if let Master::Null = master {
            let profile = gateway.profile(Direction::TxPdo, MULTIPLIER);
            let mut image = vec![0; profile.pdo_bytes()];
            let mut writer = ImageWriter::new(Direction::TxPdo, profile);
            for (number, frame) in (0..).zip(&frames) {
                let view = frame.as_ref();
                writer.push(&mut image, number % 4, 0, view, Timestamp::None).unwrap();
            }
            writer.commit(&mut image, CommitFields::default());
            ecan_bench::null_master::keep_new(port.adapter().tx_pdo(0));
            ecan_bench::null_master::replace(port.adapter().tx_pdo(0), &image);
        }
        let channels = (0..4).map(|channel| port.channel(0, channel).unwrap()).collect();
        Self { port, channels, frames, times_ns: Vec::with_capacity(CYCLES) }
    }

    fn cycle(&mut self) {
        let Self { port, channels, frames, times_ns } = self;
        let start = Instant::now();
        let mut cycle = port.begin_cycle();
        for item in cycle.received() {
            if let ReceivedView::Frame { packet, .. } = item {
                black_box(packet.frame.id());
            }
        }
        for (number, frame) in frames.iter().enumerate() {
            // A full bus may reject some.
            let _ = cycle.send(channels[number % 4], frame);
        }
        let _ = cycle.finish();
        times_ns.push(start.elapsed().as_nanos() as u64);
    }

    fn take_times(&mut self) -> Distribution {
        let times = Distribution::of(&self.times_ns);
        self.times_ns.clear();
        times
    }
}

fn connect<'a>(threads: &'a Scope<'a, '_>, path: &Path, is_over: &'a AtomicBool) -> Client {
    for _ in 0..READERS {
        let client = Client::connect(path, "reader").unwrap();
        client.subscribe(&Subscription::default()).unwrap();
        threads.spawn(move || {
            while !is_over.load(Ordering::Acquire) {
                black_box(client.poll(PERIOD).unwrap());
            }
        });
    }
    let monitor = Client::connect(path, "monitor").unwrap();
    threads.spawn(move || {
        while !is_over.load(Ordering::Acquire) {
            let _ = black_box(monitor.state());
            sleep(100 * PERIOD);
        }
    });
    let silent = Client::connect(path, "never reads").unwrap();
    silent.subscribe(&Subscription::default()).unwrap();
    silent
}

/// Rows of a master: p50 and p99.
fn measure(master: Master) -> [Row; 2] {
    let (mut served, mut alone) = (Side::new(master), Side::new(master));
    if let Master::Null = master {
        ecan_bench::null_master::freeze();
    }
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("bench.sock");
    let service = served.port.serve(ServiceConfig::new(&path)).unwrap();
    let is_over = AtomicBool::new(false);
    let (mut pairs_p50, mut pairs_p99) = (Vec::new(), Vec::new());
    scope(|threads| {
        // Ends the threads of the clients also after a panic.
        let _end = OnDrop(|| is_over.store(true, Ordering::Release));
        let _silent = connect(threads, &path, &is_over);
        let cycle = threads.spawn(|| {
            // Without the permission the threads of the clients disturb both sides more.
            let _ = RealTimeConfig { priority: Some(80), ..RealTimeConfig::default() }.apply();
            let mut next = Instant::now();
            for _ in 0..rounds(SEGMENTS) {
                for _ in 0..rounds(CYCLES) {
                    for side in [&mut served, &mut alone] {
                        next = Instant::now().max(next + PERIOD);
                        sleep(next.saturating_duration_since(Instant::now()));
                        side.cycle();
                    }
                }
                let (with, without) = (served.take_times(), alone.take_times());
                pairs_p50.push([with.p50_ns, without.p50_ns]);
                pairs_p99.push([with.p99_ns, without.p99_ns]);
            }
        });
        cycle.join().unwrap();
    });
    drop(service);
    let (name, what) = match master {
        Master::Null => ("null master", "with clients / without a service, no system calls"),
        Master::Simulated => ("simulated master", "with clients / without a service"),
    };
    let row = |percentile: &str, pairs: &[[u64; 2]]| {
        let of = |at: usize| median(pairs.iter().map(|pair| pair[at] as f64).collect());
        println!("{name}: {percentile} {:.0} ns with clients, {:.0} ns without", of(0), of(1));
        let ratio =
            median(pairs.iter().map(|[with, without]| *with as f64 / *without as f64).collect());
        Row::new(format!("cycle with 8 clients of its service, {name}, {percentile}"), what, ratio)
    };
    let (p50, p99) = (row("p50", &pairs_p50), row("p99", &pairs_p99));
    match master {
        Master::Null => [p50, p99],
        Master::Simulated => [p50.with_goals(1.05, 1.05), p99],
    }
}

fn main() {
    let rows = [measure(Master::Simulated), measure(Master::Null)].concat();
    print_rows(&rows);
}
