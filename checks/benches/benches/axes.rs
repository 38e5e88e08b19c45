//! What an axis costs the host in a cycle: taking TPDOs, deciding, sending targets; with ten axes
//! and with forty. And what publishing a snapshot for observers adds to a whole cycle of ten axes.
//!
//! ```text
//! cargo bench -p ecan-cia402 --bench axes
//! ```
//!
//! The axes are started on simulated drives. A cycle in which every axis sent its TPDO is then
//! frozen and played again and again, so that nothing of the simulator is in the caches or in the
//! time: every axis follows targets, at standstill. Ten and forty axes take turns.
#![allow(missing_docs)]

use std::cell::RefCell;
use std::time::{Duration, Instant};

use ecan_bench::measure::{Outcome, Row, interleaved, print_rows, rounds};
use ecan_canopen::{NodeAddress, NodeId};
use ecan_cia402::{AxesSnapshot, AxisConfig, AxisRef, Cia402, Cia402Config};
use ecan_host::AdapterConfig;
use ecan_mcan_port::{ChannelConfig, GatewayConfig, Port, PortConfig};
use ecan_protocol::image::Header;

/// Axes of a channel and of a gateway.
const ON_CHANNEL: usize = 4;
const ON_GATEWAY: usize = 16;
/// Cycles until all TPDOs of a cycle lie in one image.
const MOST_CYCLES: usize = 2_000;
const ROUNDS: usize = 3001;
const WARM_UP: usize = 100;
/// Cycles in a round.
const REPEAT: usize = 8;

fn axis(number: usize) -> AxisConfig {
    AxisConfig::new(NodeAddress {
        slave: number / ON_GATEWAY,
        channel: (number % ON_GATEWAY / ON_CHANNEL) as u8,
        node: NodeId::new((number % ON_CHANNEL) as u8 + 1).unwrap(),
    })
}

struct Bench {
    axes: usize,
    port: Port,
    cia402: Cia402,
}

impl Bench {
    fn started(axes: usize, multiplier: u8) -> Self {
        let slaves = axes.div_ceil(ON_GATEWAY);
        let ecrt =
            ecan_bench::null_master::open(ecan_sim::drives(slaves, ON_CHANNEL as u8)).unwrap();
        let adapter = AdapterConfig::new(slaves as u16)
            .with_multiplier(multiplier)
            .with_cycle(Duration::from_millis(2));
        let gateway = GatewayConfig::on_all_channels(ChannelConfig::classic(1_000_000));
        let mut port = Port::open(&ecrt, (adapter, PortConfig::uniform(slaves, gateway))).unwrap();
        port.wait_ready().unwrap();
        let settings = (0..axes).map(axis).collect();
        let mut cia402 = Cia402::new(&port, settings, Cia402Config::default()).unwrap();
        cia402.blocking(&mut port, Duration::from_secs(20)).start_up().unwrap();
        let mut bench = Self { axes, port, cia402 };
        bench.find_full_cycle();
        bench
    }

    /// Runs to a cycle in whose images every axis has its TPDO, and nothing else lies.
    fn find_full_cycle(&mut self) {
        for _ in 0..MOST_CYCLES {
            self.port.wait_next_cycle();
            self.cycle();
            let is_full = (0..self.port.slave_count()).all(|slave| {
                let image = self.port.adapter().tx_pdo(slave);
                let axes = (self.axes - slave * ON_GATEWAY).min(ON_GATEWAY);
                let header = image.first_chunk().map(Header::parse);
                header.is_some_and(|header| usize::from(header.frame_count) == axes)
            });
            if is_full {
                for slave in 0..self.port.slave_count() {
                    ecan_bench::null_master::keep_new(self.port.adapter().tx_pdo(slave));
                }
                return;
            }
        }
        panic!("{} axes never had all their TPDOs in one cycle", self.axes);
    }

    /// A cycle; nanoseconds of the axes' part.
    fn cycle(&mut self) -> f64 {
        let mut cycle = self.port.begin_cycle();
        let start = Instant::now();
        self.cia402.process_rx(&mut cycle);
        let summary = self.cia402.send_targets_all(&mut cycle);
        let time = start.elapsed().as_nanos() as f64;
        cycle.end().unwrap();
        assert_eq!(summary.targets, self.axes, "{summary:?}");
        time
    }

    fn round(&mut self) -> f64 {
        (0..REPEAT).map(|_| self.cycle()).sum()
    }

    /// Whole cycles, with the wait, which takes no time on the frozen clock, and with targets of the
    /// application.
    fn whole_round(&mut self) -> f64 {
        let start = Instant::now();
        for _ in 0..REPEAT {
            let mut cycle = self.port.next_cycle();
            self.cia402.process_rx(&mut cycle);
            for axis in 0..self.axes {
                let target = self.cia402.axis(axis).and_then(AxisRef::target).unwrap();
                self.cia402.axis_mut(axis).unwrap().set_target(target).unwrap();
            }
            let summary = self.cia402.send_targets_all(&mut cycle);
            cycle.end().unwrap();
            assert_eq!(summary.targets, self.axes, "{summary:?}");
        }
        start.elapsed().as_nanos() as f64
    }

    fn received(&self) -> u64 {
        self.cia402.axes().map(|axis| axis.statistics().tpdos).sum()
    }
}

fn main() {
    let (mut ten, mut forty) = (Bench::started(10, 6), Bench::started(40, 6));
    let whole = RefCell::new(Bench::started(10, 3));
    ecan_bench::null_master::freeze();
    let mut measure = |rounds| interleaved(rounds, || forty.round(), || ten.round());
    measure(rounds(WARM_UP));
    let Outcome { first, second, ratio } = measure(rounds(ROUNDS));
    // Every axis followed targets and got its TPDO throughout.
    for bench in [&mut ten, &mut forty] {
        let before = bench.received();
        bench.round();
        assert_eq!(bench.received() - before, (REPEAT * bench.axes) as u64);
        assert!(bench.cia402.all_running());
    }
    println!(
        "Time of an axis in a cycle: {:.0} ns of 10, {:.0} ns of 40.",
        second / (REPEAT * 10) as f64,
        first / (REPEAT * 40) as f64
    );
    let axis = Row::new("host cost per axis", "one axis of 40 / one axis of 10", ratio / 4.0);

    // The same Port with and without an observer.
    let observed = || {
        let observer = whole.borrow().port.adapter().observer();
        let time = whole.borrow_mut().whole_round();
        let mut snapshot = observer.snapshot();
        snapshot.update().unwrap();
        assert_eq!(AxesSnapshot::of(&snapshot).unwrap().axis_count(), 10);
        time
    };
    let measure = |rounds| interleaved(rounds, observed, || whole.borrow_mut().whole_round());
    measure(rounds(WARM_UP));
    let Outcome { first, second, ratio } = measure(rounds(ROUNDS));
    let cycle_ns = |round: f64| round / REPEAT as f64;
    println!(
        "\nTime of a whole cycle of 10 axes with N = 3: {:.0} ns with a snapshot, {:.0} ns without.",
        cycle_ns(first),
        cycle_ns(second)
    );
    let what =
        "publishing / whole cycle without system calls (null master); with them see the remarks";
    let snapshot = Row::new("snapshot for observers, 10 axes, N = 3", what, ratio - 1.0);
    print_rows(&[axis.with_goals(1.15, 1.15), snapshot.as_share().with_goals(0.02, 0.02)]);
}
