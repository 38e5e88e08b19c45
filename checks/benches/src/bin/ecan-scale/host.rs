//! Time of the host in a cycle, by the number of gateways and of axes, on a master without data exchange.

use std::cell::RefCell;
use std::hint::black_box;
use std::time::{Duration, Instant};

use ecan_bench::measure::{median, rounds};
use ecan_canopen::{NodeAddress, NodeId};
use ecan_cia402::{AxisConfig, Cia402, Cia402Config};
use ecan_host::AdapterConfig;
use ecan_mcan_port::{
    ChannelConfig, CpuCost, FrameRate, FrameStream, GatewayConfig, Port, PortConfig, PortPlan,
    ReceivedView,
};
use ecan_protocol::can::{CanFrame, CanId};
use ecan_protocol::image::{CommitFields, ImageWriter, Timestamp};
use ecan_protocol::mapping::Direction;

use crate::Fallible;
use crate::page::{Section, compared};

const GATEWAYS: [usize; 5] = [1, 2, 4, 8, 16];
const AXES: [usize; 5] = [10, 20, 40, 80, 160];
/// In each image of several gateways.
const FRAMES: usize = 10;
/// In each image of one gateway; N = 3 carries 30.
const FRAMES_OF_ONE: [usize; 4] = [1, 10, 20, 30];
const ON_CHANNEL: usize = 4;
const ON_GATEWAY: usize = 16;
const ROUNDS: usize = 501;
const REPEAT: usize = 16;
/// Cycles until every axis has its TPDO in one image.
const MOST_CYCLES: usize = 4_000;

/// The sections of gateways, frames and axes, measured in turn.
pub fn sections() -> Fallible<[Section; 3]> {
    let gateways = open(&GATEWAYS, |count| Exchange::new(count, FRAMES))?;
    let frames = open(&FRAMES_OF_ONE, |count| Exchange::new(1, count))?;
    let axes = open(&AXES, Axes::new)?;
    // Nothing can be opened any more.
    ecan_bench::null_master::freeze();
    let planned =
        |all: &[Exchange]| all.iter().map(|exchange| Some(exchange.planned_ns)).collect::<Vec<_>>();
    let plans = [planned(&gateways), planned(&frames), vec![None; axes.len()]];
    let [of_gateways, of_frames, of_axes] = plans;
    let gateways = Section {
        name: "gateways",
        title: "Host: time of the SDK in a cycle, N = 3, 10 frames each way",
        x_label: "gateways",
        ..section(&GATEWAYS, &of_gateways, &in_turn(gateways, Exchange::cycle))
    };
    let frames = Section {
        name: "frames",
        title: "Host: time of the SDK in a cycle, one gateway, N = 3",
        x_label: "frames each way",
        ..section(&FRAMES_OF_ONE, &of_frames, &in_turn(frames, Exchange::cycle))
    };
    let axes = Section {
        name: "axes",
        title: "Host: time of the SDK in a cycle, 16 axes on a gateway, N = 6",
        x_label: "axes",
        ..section(&AXES, &of_axes, &in_turn(axes, Axes::cycle))
    };
    Ok([gateways, frames, axes])
}

fn open<T>(counts: &[usize], new: impl Fn(usize) -> Fallible<T>) -> Fallible<Vec<T>> {
    counts.iter().map(|count| new(*count)).collect()
}

/// Table and curves; names and titles are the caller's.
fn section(counts: &[usize], planned: &[Option<f64>], measured: &[f64]) -> Section {
    let us = |ns: f64| ns / 1e3;
    let xs = || counts.iter().map(|count| *count as f64);
    let formula = xs().zip(planned).filter_map(|(x, ns)| Some((x, us((*ns)?)))).collect();
    let run = xs().zip(measured).map(|(x, ns)| (x, us(*ns))).collect();
    let mut panel = compared("", "time in a cycle [us]", formula, ("measured", run));
    panel.series.retain(|series| !series.points.is_empty());
    let row = |((count, planned), ns): ((&usize, &Option<f64>), &f64)| {
        let planned = planned.map(|ns| format!("{:.2}", us(ns)));
        let cells = [Some(count.to_string()), planned, Some(format!("{:.2}", us(*ns)))];
        let each = Some(format!("{:.0}", ns / *count as f64));
        cells.into_iter().chain([each]).flatten().collect()
    };
    let rows = counts.iter().zip(planned).zip(measured).map(row).collect();
    let has_plan = planned.iter().any(Option::is_some);
    let codec = has_plan.then_some("codec by the planner, us");
    let header = [Some("number"), codec, Some("whole cycle, us"), Some("for each one, ns")];
    Section {
        name: "",
        title: "",
        x_label: "",
        panels: vec![panel],
        is_simulated: false,
        header: header.into_iter().flatten().map(str::to_owned).collect(),
        rows,
    }
}

/// Median time of a cycle of each, measured in turn.
fn in_turn<T>(all: Vec<T>, cycle: impl Fn(&mut T)) -> Vec<f64> {
    let all: Vec<RefCell<T>> = all.into_iter().map(RefCell::new).collect();
    let mut times = vec![Vec::new(); all.len()];
    for _ in 0..rounds(ROUNDS) {
        for (one, times) in all.iter().zip(&mut times) {
            let start = Instant::now();
            for _ in 0..REPEAT {
                cycle(&mut one.borrow_mut());
            }
            times.push(start.elapsed().as_nanos() as f64 / REPEAT as f64);
        }
    }
    times.into_iter().map(median).collect()
}

/// Gateways that exchange frames.
struct Exchange {
    port: Port,
    frames: Vec<CanFrame>,
    planned_ns: f64,
}

impl Exchange {
    fn new(gateways: usize, frames: usize) -> Fallible<Self> {
        let gateway = GatewayConfig {
            paced: false,
            ..GatewayConfig::on_all_channels(ChannelConfig::classic(1_000_000))
        };
        let adapter = AdapterConfig::new(gateways as u16).with_cycle(Duration::from_millis(2));
        let config = PortConfig::uniform(gateways, gateway);
        let frame = |n| CanFrame::classic(CanId::standard(0x100 + n)?, &[1, 2, 3, 4, 5, 6, 7, 8]);
        let rate = FrameRate::PerCycle(frames as u32);
        let frames = (0..frames as u16).map(frame).collect::<Result<Vec<_>, _>>()?;
        let traffic: Vec<FrameStream> = (0..gateways)
            .flat_map(|slave| {
                [
                    FrameStream::to_bus(slave, 0, frames[0], rate),
                    FrameStream::from_bus(slave, 0, frames[0], rate),
                ]
            })
            .collect();
        let planned_ns = PortPlan::of(&adapter, &config, &traffic).cpu_ns(CpuCost::MEASURED);
        let multiplier = adapter.slaves[0].tx_multiplier;
        let ecrt = ecan_bench::null_master::open(ecan_sim::echo(gateways))?;
        let mut port = Port::open(&ecrt, (adapter, config))?;
        port.wait_ready()?;
        let profile = gateway.profile(Direction::TxPdo, multiplier);
        let mut image = vec![0; profile.pdo_bytes()];
        let mut writer = ImageWriter::new(Direction::TxPdo, profile);
        for (number, frame) in (0..).zip(&frames) {
            writer.push(&mut image, number % 4, 0, frame.as_ref(), Timestamp::None)?;
        }
        writer.commit(&mut image, CommitFields::default());
        for slave in 0..gateways {
            ecan_bench::null_master::keep_new(port.adapter().tx_pdo(slave));
            ecan_bench::null_master::replace(port.adapter().tx_pdo(slave), &image);
        }
        Ok(Self { port, frames, planned_ns })
    }

    fn cycle(&mut self) {
        let Self { port, frames, .. } = self;
        let mut cycle = port.begin_cycle();
        for item in cycle.received() {
            if let ReceivedView::Frame { packet, .. } = item {
                black_box(packet.frame.id());
            }
        }
        for slave in 0..cycle.slave_count() {
            for (number, frame) in (0..).zip(&*frames) {
                let channel = cycle.channel(slave, number % 4).expect("four channels");
                cycle.send(channel, frame).expect("the image carries all frames");
            }
        }
        cycle.end().expect("no master that fails");
    }
}

/// Axes that follow targets at standstill.
struct Axes {
    port: Port,
    cia402: Cia402,
}

impl Axes {
    fn new(axes: usize) -> Fallible<Self> {
        let gateways = axes.div_ceil(ON_GATEWAY);
        let ecrt = ecan_bench::null_master::open(ecan_sim::drives(gateways, ON_CHANNEL as u8))?;
        let adapter = AdapterConfig::new(gateways as u16)
            .with_multiplier(6)
            .with_cycle(Duration::from_millis(4));
        let gateway = GatewayConfig::on_all_channels(ChannelConfig::classic(1_000_000));
        let mut port = Port::open(&ecrt, (adapter, PortConfig::uniform(gateways, gateway)))?;
        port.wait_ready()?;
        let config = (0..axes).map(axis).collect();
        let mut cia402 = Cia402::new(&port, config, Cia402Config::default())?;
        cia402.blocking(&mut port, Duration::from_secs(60)).start_up()?;
        let mut started = Self { port, cia402 };
        started.find_full_cycle()?;
        Ok(started)
    }

    /// Runs to a cycle in which every axis has its TPDO, and keeps its images.
    fn find_full_cycle(&mut self) -> Fallible<()> {
        let axes = self.cia402.axis_count() as u64;
        for _ in 0..MOST_CYCLES {
            let before = self.tpdos();
            self.port.wait_next_cycle();
            self.cycle();
            if self.tpdos() - before == axes {
                for slave in 0..self.port.slave_count() {
                    ecan_bench::null_master::keep_new(self.port.adapter().tx_pdo(slave));
                }
                return Ok(());
            }
        }
        Err(format!("{axes} axes never had all their TPDOs in one cycle").into())
    }

    fn tpdos(&self) -> u64 {
        self.cia402.axes().map(|axis| axis.statistics().tpdos).sum()
    }

    fn cycle(&mut self) {
        let mut cycle = self.port.begin_cycle();
        self.cia402.process_rx(&mut cycle);
        self.cia402.send_targets_all(&mut cycle);
        cycle.end().expect("no master that fails");
    }
}

fn axis(number: usize) -> AxisConfig {
    AxisConfig::new(NodeAddress {
        slave: number / ON_GATEWAY,
        channel: (number % ON_GATEWAY / ON_CHANNEL) as u8,
        node: NodeId::new((number % ON_CHANNEL) as u8 + 1).expect("1 to 4"),
    })
}
