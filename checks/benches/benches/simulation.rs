//! How fast the simulator runs: CiA 402 axes over the whole host stack, in stepped time, on buses
//! with exact bit times.
//!
//! ```text
//! cargo bench -p ecan-cia402 --bench simulation
//! ```
//!
//! Each line is a number of axes, a cycle time and a number of CAN frames per cycle, as counted on
//! the buses. The
//! figure is simulated seconds per second of wall-clock time, host included: the median of some
//! segments of one run, with the least and the greatest. The shares come from further segments
//! that are timed in parts: the world (sleeping until the next cycle), the host's axes (taking
//! TPDOs, sending targets), and begin and end of the cycle, which are host and simulated library
//! together. A run counts only if every axis followed targets throughout and no TPDO was lost.
//!
//! Without `--bench`, as `cargo test` runs it, a single short segment shows that it works. A number
//! as argument runs only that line, from 0, for a profile.

use std::process::ExitCode;
use std::time::{Duration, Instant};

use ecan_canopen::{
    CobId, MappingEntry, NodeAddress, NodeId, PdoDirection, PdoMapping, PdoMappingError,
    TransmissionType, object,
};
use ecan_cia402::{AxisConfig, Cia402, Cia402Config};
use ecan_host::AdapterConfig;
use ecan_mcan_port::{ChannelConfig, GatewayConfig, Port, PortConfig};
use ecan_protocol::mapping::CHANNELS;
use ecan_sim::{ClockKind, SimOptions, Simulation};

type Fallible<T> = Result<T, Box<dyn std::error::Error>>;

const BITRATE: u32 = 1_000_000;
/// Increments per cycle that every axis moves.
const STEP: i32 = 5;
/// How long gateways and drives may take to start, in simulated milliseconds.
const START_UP: Duration = Duration::from_secs(20);
/// Cycles before the first segment: the axes come up to speed.
const WARM_UP_CYCLES: u32 = 500;
/// Simulated time of a segment.
const SEGMENT: Duration = Duration::from_secs(5);
const SEGMENTS: usize = 15;

/// What a line of the table is about.
#[derive(Clone, Copy)]
struct Case {
    gateways: usize,
    axes: usize,
    cycle_us: u32,
    /// RPDOs, TPDOs and SYNCs in a cycle; heartbeats come on top now and then.
    frames: u32,
    /// TPDOs of each axis.
    tpdos: fn(usize) -> u8,
}

/// Of ten axes, channels 0 and 1 have three, channels 2 and 3 have two. A channel's status word
/// counts up to six received frames that wait, so more TPDOs per cycle would look like a backlog:
/// with six on every channel a cycle has 38 frames.
fn six_tpdos_a_channel(axis: usize) -> u8 {
    if axis % CHANNELS < 2 { 2 } else { 3 }
}

/// Ten axes on one gateway.
const TEN: Case = Case { gateways: 1, axes: 10, cycle_us: 1_000, frames: 24, tpdos: |_| 1 };

const CASES: [Case; 4] = [
    TEN,
    Case { cycle_us: 2_000, frames: 38, tpdos: six_tpdos_a_channel, ..TEN },
    Case { cycle_us: 10_000, frames: 38, tpdos: six_tpdos_a_channel, ..TEN },
    Case { gateways: 3, axes: 40, frames: 92, ..TEN },
];

impl Case {
    /// Buses, all with axes.
    fn buses(&self) -> usize {
        self.gateways * CHANNELS
    }
}

/// A further TPDO, sent with every SYNC.
fn further_tpdo(node: NodeId, number: u8) -> Result<PdoMapping, PdoMappingError> {
    let entries = match number {
        2 => vec![
            MappingEntry::new(object::VELOCITY_ACTUAL, 0, 32),
            MappingEntry::new(object::TORQUE_ACTUAL, 0, 16),
        ],
        _ => vec![MappingEntry::new(object::FOLLOWING_ERROR, 0, 32)],
    };
    Ok(PdoMapping {
        direction: PdoDirection::Transmit,
        number: number.into(),
        cob_id: CobId::tpdo(node, number).can_id(),
        transmission: TransmissionType::Synchronous(1),
        inhibit_time: None,
        event_timer_ms: None,
        sync_start: None,
        entries,
    })
}

fn axis(case: &Case, number: usize) -> Fallible<AxisConfig> {
    let (bus, tpdos) = (number % case.buses(), (case.tpdos)(number));
    let node = NodeId::new((number / case.buses()) as u8 + 1)?;
    let (slave, channel) = (bus / CHANNELS, (bus % CHANNELS) as u8);
    let address = NodeAddress { slave, channel, node };
    let mut settings = AxisConfig::new(address).with_target_step(STEP);
    for further in 2..=tpdos {
        settings.drive.further.extend(further_tpdo(node, further)?.steps()?);
    }
    Ok(settings)
}

/// Wall-clock time by part of the cycle.
#[derive(Clone, Copy, Default)]
struct Parts {
    world: Duration,
    axes: Duration,
    exchange: Duration,
}

struct Bench {
    case: Case,
    port: Port,
    cia402: Cia402,
    simulation: Simulation,
    cycle: Duration,
}

impl Bench {
    /// Axes that follow targets.
    fn start(case: &Case) -> Fallible<Self> {
        let options = SimOptions { clock: Some(ClockKind::Stepped), ..SimOptions::default() };
        let per_channel = case.axes.div_ceil(case.buses()) as u8;
        let scenario = ecan_sim::drives(case.gateways, per_channel);
        let backend = ecan_sim::open_scenario(scenario, &options)?;
        let simulation = backend.simulation.ok_or("not a simulation")?;
        let gateway = GatewayConfig::on_all_channels(ChannelConfig::classic(BITRATE));
        let adapter = AdapterConfig::new(case.gateways as u16)
            .with_cycle(Duration::from_micros(case.cycle_us.into()));
        let port = PortConfig::uniform(case.gateways, gateway);
        let mut port = Port::open(&backend.ecrt, (adapter, port))?;
        port.wait_ready()?;
        let axes = (0..case.axes).map(|number| axis(case, number)).collect::<Fallible<Vec<_>>>()?;
        let mut cia402 = Cia402::new(&port, axes, Cia402Config::default())?;
        cia402.blocking(&mut port, START_UP).start_up()?;
        let cycle = Duration::from_micros(case.cycle_us.into());
        let mut bench = Self { case: *case, port, cia402, simulation, cycle };
        bench.cycles(WARM_UP_CYCLES)?;
        Ok(bench)
    }

    fn cycles(&mut self, cycles: u32) -> Fallible<()> {
        for _ in 0..cycles {
            let mut cycle = self.port.next_cycle();
            self.cia402.process_rx(&mut cycle);
            self.cia402.send_target_step(&mut cycle);
            cycle.end()?;
        }
        Ok(())
    }

    /// The same, timed in parts.
    fn timed_cycles(&mut self, cycles: u32) -> Fallible<Parts> {
        let mut parts = Parts::default();
        let mut last = Instant::now();
        let mut lap = || {
            let now = Instant::now();
            now - std::mem::replace(&mut last, now)
        };
        for _ in 0..cycles {
            self.port.wait_next_cycle();
            parts.world += lap();
            let mut cycle = self.port.begin_cycle();
            parts.exchange += lap();
            self.cia402.process_rx(&mut cycle);
            self.cia402.send_target_step(&mut cycle);
            parts.axes += lap();
            cycle.end()?;
            parts.exchange += lap();
        }
        Ok(parts)
    }

    /// Frames on all buses so far, and the time that the buses were busy, in nanoseconds.
    fn bus_totals(&self) -> (u64, u64) {
        self.simulation.with_world(|world| {
            (0..self.case.buses())
                .filter_map(|bus| world.bus_statistics(bus / CHANNELS, bus % CHANNELS))
                .fold((0, 0), |(frames, busy), bus| (frames + bus.frames, busy + bus.busy_ns))
        })
    }

    /// Frames per cycle and share of the buses' time, over so many cycles.
    fn measure_traffic(&mut self, cycles: u32) -> Fallible<(f64, f64)> {
        let before = self.bus_totals();
        self.cycles(cycles)?;
        let after = self.bus_totals();
        let time = self.cycle.as_nanos() as f64 * f64::from(cycles);
        let frames = (after.0 - before.0) as f64 / f64::from(cycles);
        Ok((frames, (after.1 - before.1) as f64 / time / self.case.buses() as f64))
    }

    /// Returns whether the axes did what is measured.
    fn judge(&self, frames: f64) -> Fallible<()> {
        let case = &self.case;
        if !self.cia402.all_running() {
            return Err("an axis stopped following targets".into());
        }
        for axis in self.cia402.axes() {
            let statistics = axis.statistics();
            if statistics.lost_tpdos > 0 || statistics.holds > 0 {
                return Err(
                    format!("axis {} lost TPDOs or held: {statistics:?}", axis.index()).into()
                );
            }
        }
        // heartbeats: one of each axis per 100 ms, one of the host on each channel per 50 ms
        let cycles_per_s = 1.0 / self.cycle.as_secs_f64();
        let heartbeats = (10 * case.axes + 20 * case.buses()) as f64;
        let most = f64::from(case.frames) + 1.2 * heartbeats / cycles_per_s;
        if frames < f64::from(case.frames) || frames > most {
            return Err(format!("{frames:.2} frames per cycle, not {}", case.frames).into());
        }
        Ok(())
    }
}

fn run(case: &Case, segments: usize, segment: Duration) -> Fallible<()> {
    let mut bench = Bench::start(case)?;
    let cycles = (segment.as_nanos() / bench.cycle.as_nanos()) as u32;
    let (frames, load) = bench.measure_traffic(cycles)?;
    let mut factors = Vec::with_capacity(segments);
    let mut parts = Parts::default();
    for _ in 0..segments {
        let begun = Instant::now();
        bench.cycles(cycles)?;
        factors.push((bench.cycle * cycles).as_secs_f64() / begun.elapsed().as_secs_f64());
        let more = bench.timed_cycles(cycles)?;
        parts.world += more.world;
        parts.axes += more.axes;
        parts.exchange += more.exchange;
    }
    bench.judge(frames)?;
    factors.sort_by(f64::total_cmp);
    let place = |place: usize| factors.get(place).copied().unwrap_or(0.0);
    let median = place(factors.len() / 2);
    let per_cycle_us = bench.cycle.as_secs_f64() * 1e6 / median;
    let whole = (parts.world + parts.axes + parts.exchange).as_secs_f64();
    let percent = |part: Duration| part.as_secs_f64() / whole * 100.0;
    println!(
        "{:>4} {:>6} us {frames:>7.1} {:>6.0} % {median:>8.0} {:>8.0} {:>8.0} {per_cycle_us:>9.2} \
         {:>9.0} {:>8.0} % {:>7.0} % {:>7.0} %",
        case.axes,
        case.cycle_us,
        load * 100.0,
        place(0),
        place(factors.len().saturating_sub(1)),
        per_cycle_us * 1e3 / frames,
        percent(parts.world),
        percent(parts.exchange),
        percent(parts.axes),
    );
    Ok(())
}

fn main() -> ExitCode {
    let selected: Vec<usize> =
        std::env::args().filter_map(|argument| argument.parse().ok()).collect();
    let is_bench = std::env::args().any(|argument| argument == "--bench");
    let (segments, segment) =
        if is_bench { (SEGMENTS, SEGMENT) } else { (1, Duration::from_millis(200)) };
    println!(
        "Simulation of CiA 402 axes, ten on one gateway or forty on three, channels at 1 Mbit/s.\n\
         Simulated time over wall-clock time, median of {segments} segments of {segment:?}:\n\n\
         axes     cycle   frames bus load   median    least greatest  us/cycle  ns/frame     world \
         exchange    axes"
    );
    let is_selected = |number: &usize| selected.is_empty() || selected.contains(number);
    for (_, case) in CASES.iter().enumerate().filter(|(number, _)| is_selected(number)) {
        if let Err(error) = run(case, segments, segment) {
            eprintln!("simulation, {} axes, cycle of {} us: {error}", case.axes, case.cycle_us);
            return ExitCode::FAILURE;
        }
    }
    ExitCode::SUCCESS
}
