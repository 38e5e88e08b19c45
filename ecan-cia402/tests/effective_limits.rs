//! Limits as the drive executes them: judged by the drive's own record of its targets, and by the
//! velocity of its motor in each controller period.
#![allow(missing_docs)]

mod axes;

use std::time::Duration;

use axes::{Fixture, axes, axis, scenario};
use ecan_canopen::{DriveState, OperatingMode, SyncConfig, object};
use ecan_cia402::{
    AxisConfig, AxisFault, AxisPhase, Cia402, Cia402Config, Cia402Error, CommandError, Decision,
    HomingConfig, WaitReason,
};
use ecan_host::{AdapterConfig, DcSync};
use ecan_mcan_port::{ChannelConfig, Cycle, GatewayConfig, Port, PortConfig, SendOptions};
use ecan_protocol::can::{CanFrame, CanId};
use ecan_sim::{
    AttachedNode, ClockKind, DriveFault, Fault, GatewayFault, LossDirection, Node, NodeOutput,
    SimOptions, TraceEvent,
};

const STEP: u32 = 1_000;
const MS: u64 = 1_000_000;

fn adapter(cycle_us: u64) -> AdapterConfig {
    AdapterConfig::new(1).with_cycle(Duration::from_micros(cycle_us))
}

/// Axes that move at their step limit.
fn at_limit(count: usize) -> Vec<AxisConfig> {
    let table = axes(count).into_iter();
    let at_limit =
        |axis: AxisConfig| AxisConfig { ramp: STEP / 10, ..axis.with_target_step(STEP as i32) };
    table.map(at_limit).collect()
}

fn config(motion_div: u32, every_cycles: u32) -> Cia402Config {
    let sync = SyncConfig { every_cycles, ..SyncConfig::default() };
    Cia402Config { motion_div, sync, ..Cia402Config::default() }
}

fn fixture(cycle_us: u64, axes: Vec<AxisConfig>, config: Cia402Config) -> Fixture {
    let traced = scenario(1, |drive| drive.trace = 100_000);
    Fixture::open_with(traced, adapter(cycle_us), axes, config)
}

/// The motor of an axis since a time.
struct MotorWatch {
    axis: usize,
    since_ns: u64,
}

impl MotorWatch {
    fn new(fixture: &Fixture, axis: usize) -> Self {
        Self { axis, since_ns: fixture.now_ns() }
    }

    /// Velocity at the end of each controller period, in increments per second.
    fn velocities(&self, fixture: &Fixture) -> Vec<f64> {
        let new = |drive: &ecan_sim::Drive| {
            let records = drive.trace().iter().filter(|record| record.time_ns >= self.since_ns);
            let velocity = |event| match event {
                TraceEvent::Motion(sample) => Some(sample.velocity),
                _ => None,
            };
            records.filter_map(|record| velocity(record.event)).collect()
        };
        fixture.drive(self.axis, new)
    }

    /// Most targets that took effect within less than a time.
    fn most_targets(&self, fixture: &Fixture, within_ns: u64) -> usize {
        let times: Vec<u64> =
            fixture.history(self.axis).iter().map(|record| record.time_ns).collect();
        let new = times.iter().enumerate().filter(|(_, time)| **time >= self.since_ns);
        let count = |(n, from): (usize, &u64)| {
            times.iter().skip(n).take_while(|time| **time < from + within_ns).count()
        };
        new.map(count).max().unwrap_or(0)
    }

    fn range(&self, fixture: &Fixture) -> (f64, f64) {
        let velocities = self.velocities(fixture);
        assert!(!velocities.is_empty());
        let fold = |(low, high): (f64, f64), v: &f64| (low.min(*v), high.max(*v));
        velocities.iter().fold((f64::MAX, f64::MIN), fold)
    }
}

/// Pseudo-random numbers (xorshift); the seed is not 0.
struct Random(u64);

impl Random {
    fn below(&mut self, bound: u64) -> u64 {
        let Self(state) = self;
        *state ^= *state << 13;
        *state ^= *state >> 7;
        *state ^= *state << 17;
        state.wrapping_mul(0x2545_F491_4F6C_DD1D) % bound
    }
}

fn largest_step(fixture: &Fixture, axis: usize) -> u32 {
    fixture.drive(axis, |drive| drive.targets().sums().largest_step)
}

// Target period

const DIVISORS: [(u32, u32, u32); 7] =
    [(1, 1, 1), (2, 1, 2), (4, 1, 4), (1, 2, 2), (3, 2, 4), (1, 4, 4), (4, 4, 4)];

#[test]
fn motor_moves_evenly_in_every_target_period() {
    for (motion_div, every_cycles, target_cycles) in DIVISORS {
        let case = format!("motion_div {motion_div}, SYNC in every {every_cycles}");
        let mut fixture = fixture(1_000, at_limit(2), config(motion_div, every_cycles));
        fixture.start();
        fixture.steps(400);
        let watch = MotorWatch::new(&fixture, 0);
        fixture.steps(400);
        let (slowest, fastest) = watch.range(&fixture);
        let speed = f64::from(STEP) * 1_000.0 / f64::from(target_cycles);
        assert!(slowest > 0.98 * speed && fastest < 1.02 * speed, "{case}: {slowest}..{fastest}");
        let statistics = fixture.cia402.statistics(0);
        assert_eq!((statistics.waits, statistics.lost_tpdos), (0, 0), "{case}");
    }
}

#[test]
fn step_limit_applies_to_targets_that_take_effect() {
    for (motion_div, every_cycles, _) in DIVISORS {
        let mut fixture = fixture(1_000, at_limit(2), config(motion_div, every_cycles));
        fixture.start();
        fixture.steps(400);
        let case = format!("motion_div {motion_div}, SYNC in every {every_cycles}");
        assert_eq!(largest_step(&fixture, 0), STEP, "{case}");
        assert_eq!(largest_step(&fixture, 1), STEP, "{case}");
    }
}

#[test]
fn first_target_takes_effect_before_the_second() {
    for every_cycles in 1..=4 {
        let mut fixture = fixture(1_000, at_limit(1), config(1, every_cycles));
        for _ in 0..3 {
            fixture.cia402.configure_all().unwrap();
            fixture.until(5_000, |cia402| cia402.phase(0) == Some(AxisPhase::Standby));
            fixture.cia402.enable(0).unwrap();
            fixture.until(2_000, Cia402::all_running);
            fixture.steps(40);
            fixture.cia402.halt(0).unwrap();
            fixture.until(1_000, |cia402| cia402.is_at_rest(0));
            fixture.cia402.disable(0).unwrap();
            fixture
                .until(2_000, |cia402| cia402.drive_state(0) == Some(DriveState::SwitchOnDisabled));
            fixture.steps(20);
        }
        let sums = fixture.drive(0, |drive| *drive.targets().sums());
        assert_eq!(sums.firsts, 3, "SYNC in every {every_cycles}");
        assert!(sums.largest_first_offset <= 20, "SYNC in every {every_cycles}: {sums:?}");
        assert!(sums.largest_step <= STEP, "SYNC in every {every_cycles}: {sums:?}");
    }
}

#[test]
fn drive_gets_sync_period_and_target_period() {
    for (motion_div, every_cycles, target_cycles) in DIVISORS {
        let mut fixture = fixture(2_000, at_limit(1), config(motion_div, every_cycles));
        assert_eq!(
            fixture.cia402.target_period(),
            Duration::from_millis(2 * u64::from(target_cycles))
        );
        fixture.start();
        let read = |index, subindex| fixture.drive(0, |drive| drive.object(index, subindex));
        let case = format!("motion_div {motion_div}, SYNC in every {every_cycles}");
        let period_us = i64::from(every_cycles) * 2_000;
        assert_eq!(read(object::COMMUNICATION_CYCLE, 0), Some(period_us), "{case}");
        let time = object::INTERPOLATION_TIME;
        assert_eq!(read(time, 1), Some(i64::from(target_cycles) * 2), "{case}");
        assert_eq!(read(time, 2), Some(-3), "{case}");
    }
}

#[test]
fn bus_load_counts_targets_per_target_period() {
    let load = |motion_div, every_cycles| {
        let fixture = fixture(1_000, at_limit(4), config(motion_div, every_cycles));
        fixture.cia402.bus_load(&fixture.port)[0].most
    };
    assert!((load(1, 4) - load(1, 1) / 4.0).abs() < 1e-9);
    assert!((load(3, 2) - load(4, 2)).abs() < 1e-9);
}

/// Set-points, mode change, homing and fault reset need several frames in a row.
#[test]
fn procedures_work_in_longer_target_periods() {
    for (motion_div, every_cycles) in [(4, 1), (1, 2), (3, 2), (1, 4)] {
        let profile = axis(0, 0, 1).with_mode(OperatingMode::ProfilePosition);
        let mut fixture = fixture(1_000, vec![profile], config(motion_div, every_cycles));
        fixture.start();
        let from = fixture.cia402.target(0).unwrap();
        for goal in [from + 5_000, from - 3_000] {
            fixture.cia402.set_target(0, goal).unwrap();
            fixture.until(2_000, |cia402| cia402.is_target_reached(0));
            let position = fixture.drive(0, ecan_sim::Drive::position);
            assert!((position - goal).abs() < 100, "{position} {goal}");
        }
        fixture.cia402.change_mode(0, OperatingMode::CyclicPosition).unwrap();
        fixture.until(5_000, |cia402| {
            cia402.is_running(0) && cia402.mode(0) == Some(OperatingMode::CyclicPosition)
        });
        fixture.cia402.set_target_step(0, 500).unwrap();
        fixture.steps(400);
        let case = format!("motion_div {motion_div}, SYNC in every {every_cycles}");
        assert!(fixture.cia402.is_running(0), "{case}");
        let steps: Vec<_> =
            fixture.history(0).iter().rev().take(50).map(ecan_sim::TargetRecord::step).collect();
        assert_eq!(steps, [500; 50], "{case}");
        fixture.cia402.home(0, HomingConfig::new(35)).unwrap();
        fixture.idle(1);
        fixture.until(20_000, Cia402::all_running);
        fixture.strike(0, DriveFault::Error { code: 0x2310 });
        fixture.until(1_000, |cia402| cia402.phase(0) == Some(AxisPhase::Fault));
        fixture.cia402.reset_fault(0).unwrap();
        fixture.until(1_000, |cia402| cia402.drive_state(0) == Some(DriveState::SwitchOnDisabled));
        fixture.cia402.enable(0).unwrap();
        fixture.until(5_000, Cia402::all_running);
    }
}

fn table_at(cycle_ns: u64, axis: AxisConfig, motion_div: u32) -> Result<Cia402, Cia402Error> {
    let options = SimOptions { clock: Some(ClockKind::Stepped), ..SimOptions::default() };
    let backend = ecan_sim::open_scenario(ecan_sim::drives(1, 1), &options).unwrap();
    let gateway = GatewayConfig::on_all_channels(ChannelConfig::classic(1_000_000));
    let adapter = AdapterConfig::new(1).with_cycle(Duration::from_nanos(cycle_ns));
    let port = Port::open(&backend.ecrt, (adapter, PortConfig::uniform(1, gateway))).unwrap();
    Cia402::new(&port, vec![axis], config(motion_div, 1))
}

#[test]
fn period_without_interpolation_time_is_rejected() {
    let Err(Cia402Error::Axes(faults)) = table_at(333_333, axis(0, 0, 1), 1) else {
        panic!("the drive would keep an old interpolation time")
    };
    assert_eq!(faults.faults, [(0, AxisFault::TargetPeriod { period_ns: 333_333 })]);
    let velocity = axis(0, 0, 1).with_mode(OperatingMode::CyclicVelocity);
    assert!(table_at(333_333, velocity, 1).is_ok(), "a velocity is not interpolated");
    assert!(table_at(400_000, axis(0, 0, 1), 3).is_ok());
    assert!(table_at(500_000, axis(0, 0, 1), 513).is_err(), "256.5 ms");
}

#[test]
fn mode_change_to_csp_needs_an_interpolation_time() {
    let profile = axis(0, 0, 1).with_mode(OperatingMode::ProfilePosition);
    let mut cia402 = table_at(333_333, profile, 1).unwrap();
    let rejected = cia402.change_mode(0, OperatingMode::CyclicPosition);
    assert_eq!(rejected, Err(CommandError::TargetPeriod { axis: 0, period_ns: 333_333 }));
}

#[test]
fn motion_div_changes_only_before_configuration() {
    let mut fixture = fixture(2_000, at_limit(2), config(1, 1));
    fixture.cia402.set_motion_div(2).unwrap();
    assert_eq!(fixture.cia402.target_period(), Duration::from_millis(4));
    let rejected = fixture.cia402.set_motion_div(333);
    assert_eq!(rejected, Err(CommandError::TargetPeriod { axis: 0, period_ns: 666 * MS }));
    assert_eq!(fixture.cia402.target_period(), Duration::from_millis(4));
    fixture.cia402.configure(1).unwrap();
    let configured = Err(CommandError::Configured { axis: 1 });
    assert_eq!(fixture.cia402.set_motion_div(1), configured);
    fixture.start();
    assert_eq!(fixture.cia402.set_motion_div(1), Err(CommandError::Configured { axis: 0 }));
}

// Cycles without calls

#[test]
fn cycle_without_process_rx_sends_no_target() {
    let mut fixture = fixture(2_000, at_limit(1), config(1, 1));
    fixture.start();
    fixture.steps(100);
    let sent = fixture.cia402.statistics(0).targets_sent;
    for _ in 0..5 {
        let mut cycle = fixture.port.next_cycle();
        let summary = fixture.cia402.send_target_step(&mut cycle);
        assert_eq!((summary.targets, summary.waiting), (0, 1));
        assert_eq!(fixture.cia402.decision(0), Decision::Wait(WaitReason::NotReceived));
    }
    assert_eq!(fixture.cia402.statistics(0).targets_sent, sent);
}

/// A frame of the application is repeated, so that the SYNC of a target waits. The next target must
/// not share it.
#[test]
fn target_without_its_sync_delays_the_next() {
    let mut fixture = fixture(2_000, at_limit(1), config(1, 1));
    fixture.start();
    fixture.steps(100);
    for _ in 0..10 {
        let mut cycle = fixture.port.next_cycle();
        fixture.cia402.process_rx(&mut cycle);
        send_other_frame(&mut cycle);
        let lost = Fault::LostFrame { direction: LossDirection::Outward, cycles: 1 };
        fixture.simulation.inject(lost);
        drop(cycle);
        let mut cycle = fixture.port.next_cycle();
        fixture.cia402.send_target_step(&mut cycle);
        drop(cycle);
        fixture.steps(10);
    }
    assert!(fixture.cia402.all_running());
    assert_eq!(largest_step(&fixture, 0), STEP);
}

fn send_other_frame(cycle: &mut Cycle<'_>) {
    let channel = cycle.channel(0, 0).unwrap();
    let frame = CanFrame::classic(CanId::standard(0x7E0).unwrap(), &[1]).unwrap();
    cycle.send_with(channel, frame.as_ref(), SendOptions::default()).unwrap();
}

/// Random cycles without the one or the other call, while frames are lost.
#[test]
fn skipped_calls_keep_the_step_limit() {
    for seed in 1..=4_u64 {
        let mut fixture = fixture(2_000, at_limit(2), config(1, 1));
        fixture.start();
        let mut random = Random(seed);
        let mut draw = |bound| random.below(bound);
        for _ in 0..1_500 {
            if draw(20) == 0 {
                let direction =
                    if draw(2) == 0 { LossDirection::Outward } else { LossDirection::Return };
                fixture.inject(Fault::LostFrame { direction, cycles: 1 + draw(2) as u32 });
            }
            let (receives, sends, others) = (draw(4) > 0, draw(4) > 0, draw(4) == 0);
            let mut cycle = fixture.port.next_cycle();
            if receives {
                fixture.cia402.process_rx(&mut cycle);
            }
            if others {
                send_other_frame(&mut cycle);
            }
            if sends {
                fixture.cia402.send_target_step(&mut cycle);
            }
            drop(cycle);
            if !fixture.cia402.all_running() && draw(50) == 0 {
                let _ = fixture.cia402.enable_all();
            }
        }
        for axis in 0..2 {
            let step = largest_step(&fixture, axis);
            assert!(step <= STEP, "seed {seed} axis {axis}: {step}");
        }
        fixture.check();
    }
}

// Frames that wait in the gateway

/// Occupies its bus with frames of highest priority for some time.
struct BusyNode {
    from_ns: u64,
    until_ns: u64,
}

impl Node for BusyNode {
    fn next_event(&self) -> Option<u64> {
        (self.from_ns < self.until_ns).then_some(self.from_ns)
    }

    fn advance(&mut self, _now: u64, out: &mut NodeOutput) {
        self.from_ns = u64::MAX;
        self.occupy(out);
    }

    fn transmitted(&mut self, now: u64, _frame: &CanFrame, out: &mut NodeOutput) {
        if now < self.until_ns {
            self.occupy(out);
        }
    }
}

impl BusyNode {
    fn occupy(&self, out: &mut NodeOutput) {
        out.send(CanFrame::classic(CanId::standard(1).unwrap(), &[0; 8]).unwrap());
    }
}

/// Occupies the bus of the first channel for a time that begins now.
fn occupy_bus(fixture: &Fixture, ms: u64) -> AttachedNode {
    let from_ns = fixture.now_ns();
    let node = BusyNode { from_ns, until_ns: from_ns + ms * MS };
    fixture.simulation.attach_node("0.0", "busy", Box::new(node)).unwrap()
}

/// Most targets that take effect together after the bus was occupied once: those of the image that
/// the status of the channel includes, of the one after it, and of the present cycle.
const TOGETHER: usize = 3;
/// The drive follows three steps in one target period; its position controller adds what it needs to
/// accelerate.
const FASTEST_TOGETHER: f64 = 4.0;
/// One more if the bus is occupied again while answers to earlier SYNCs still arrive.
const COMBINED_TOGETHER: usize = 4;
const FASTEST_COMBINED: f64 = 5.0;
/// A stalled gateway: the image in its sync manager, and the repeated one.
const STALLED_TOGETHER: usize = 2;
const FASTEST_STALLED: f64 = 2.5;

/// An axis at its limit while a fault occurs.
struct Disturbed {
    /// Most targets that took effect in less than a target period.
    together: usize,
    /// Highest speed as a multiple of the limit.
    fastest: f64,
}

impl Disturbed {
    fn run(fixture: &mut Fixture, fault: impl FnOnce(&Fixture) -> Option<AttachedNode>) -> Self {
        fixture.steps(200);
        let watch = MotorWatch::new(fixture, 0);
        let node = fault(fixture);
        fixture.steps(150);
        drop(node);
        Self::since(fixture, &watch)
    }

    fn since(fixture: &Fixture, watch: &MotorWatch) -> Self {
        let period_ns = fixture.cia402.target_period().as_nanos() as u64;
        let (backward, forward) = watch.range(fixture);
        let limit = f64::from(STEP) * 1e9 / period_ns as f64;
        let together = watch.most_targets(fixture, period_ns);
        Self { together, fastest: forward.max(-backward) / limit }
    }
}

#[test]
fn occupied_bus_releases_few_targets_together() {
    for (cycle_us, count) in [(1_000, 4), (2_000, 4), (4_000, 1)] {
        for ms in [2, 12, 40] {
            let mut fixture = fixture(cycle_us, at_limit(count), config(1, 1));
            fixture.start();
            let disturbed = Disturbed::run(&mut fixture, |fixture| Some(occupy_bus(fixture, ms)));
            let case = format!("{count} axes, {cycle_us} us, {ms} ms");
            assert!(disturbed.together <= TOGETHER, "{case}: {}", disturbed.together);
            assert!(disturbed.fastest < FASTEST_TOGETHER, "{case}: {}", disturbed.fastest);
            assert!(largest_step(&fixture, 0) <= STEP, "{case}");
        }
    }
}

#[test]
fn stalled_gateway_releases_two_targets_together() {
    for cycle_us in [1_000, 2_000, 4_000] {
        for (ms, phase) in [(3, 300), (5, 600), (8, 0), (10, 300)] {
            let mut fixture = fixture(cycle_us, at_limit(2), config(1, 1));
            fixture.start();
            let disturbed = Disturbed::run(&mut fixture, |fixture| {
                fixture.simulation.pass_ns(phase * cycle_us);
                fixture.inject(stall(ms));
                None
            });
            let case = format!("{cycle_us} us, {ms} ms, phase {phase}");
            assert!(disturbed.together <= STALLED_TOGETHER, "{case}: {}", disturbed.together);
            assert!(disturbed.fastest < FASTEST_STALLED, "{case}: {}", disturbed.fastest);
            assert!(largest_step(&fixture, 0) <= STEP, "{case}");
        }
    }
}

fn stall(ms: u32) -> Fault {
    Fault::Gateway { gateway: 0, fault: GatewayFault::ServiceStall { ms } }
}

/// Faults in any combination, at any phase of the cycle.
#[test]
fn combined_faults_release_few_targets_together() {
    for seed in [1, 2, 3, 172] {
        let mut random = Random(seed);
        let cycle_us = [1_000, 2_000, 4_000][random.below(3) as usize];
        let count = 1 + random.below(4) as usize;
        let mut fixture = fixture(cycle_us, at_limit(count), config(1, 1));
        fixture.start();
        for _ in 0..20 {
            let watch = MotorWatch::new(&fixture, 0);
            let mut nodes = Vec::new();
            for _ in 0..=random.below(2) {
                fixture.simulation.pass_ns(random.below(cycle_us) * 500);
                let cycles = 1 + random.below(3) as u32;
                match random.below(5) {
                    0 => nodes.push(occupy_bus(&fixture, 1 + random.below(12))),
                    1 => fixture.inject(stall(1 + random.below(10) as u32)),
                    2 => {
                        let frames = 1 + random.below(25) as u32;
                        fixture.inject(Fault::ErrorFrames { gateway: 0, channel: 0, frames });
                    }
                    3 => fixture
                        .inject(Fault::LostFrame { direction: LossDirection::Outward, cycles }),
                    _ => fixture
                        .inject(Fault::LostFrame { direction: LossDirection::Return, cycles }),
                }
                fixture.steps(random.below(4) as usize);
            }
            fixture.steps(30);
            let disturbed = Disturbed::since(&fixture, &watch);
            assert!(disturbed.together <= COMBINED_TOGETHER, "seed {seed}: {}", disturbed.together);
            assert!(disturbed.fastest < FASTEST_COMBINED, "seed {seed}: {}", disturbed.fastest);
            drop(nodes);
            restart(&mut fixture);
        }
        assert!(largest_step(&fixture, 0) <= STEP, "seed {seed}");
    }
}

/// Enables what a fault stopped; at the end all axes move at their limit.
fn restart(fixture: &mut Fixture) {
    for _ in 0..2_000 {
        for axis in 0..fixture.cia402.axis_count() {
            let _ = match fixture.cia402.phase(axis) {
                Some(AxisPhase::Fault) => fixture.cia402.reset_fault(axis),
                Some(AxisPhase::Standby | AxisPhase::Holding(_)) => fixture.cia402.enable(axis),
                _ => Ok(()),
            };
        }
        fixture.step();
        if fixture.cia402.all_running() {
            break;
        }
    }
    fixture.until(1, Cia402::all_running);
    fixture.steps(60);
}

#[test]
fn released_velocities_keep_the_step_limit() {
    for cycle_us in [1_000, 4_000] {
        let table: Vec<_> = at_limit(2)
            .into_iter()
            .map(|axis| axis.with_mode(OperatingMode::CyclicVelocity))
            .collect();
        let mut fixture = fixture(cycle_us, table, config(1, 1));
        fixture.start();
        accelerate(&mut fixture, 30);
        let watch = MotorWatch::new(&fixture, 0);
        let node = occupy_bus(&fixture, 12);
        accelerate(&mut fixture, 100);
        drop(node);
        let period_ns = cycle_us * 1_000;
        assert!(watch.most_targets(&fixture, period_ns) <= TOGETHER, "{cycle_us} us");
        let velocities = watch.velocities(&fixture);
        let change = velocities.windows(2).map(|pair| pair[1] - pair[0]).fold(0.0, f64::max);
        let limit = f64::from(STEP) * TOGETHER as f64;
        assert!(change <= limit, "{cycle_us} us: {change} in one controller period");
    }
}

/// The stop follows the targets that wait in the gateway at once, with a SYNC of its own.
#[test]
fn stop_on_an_occupied_bus_follows_the_waiting_targets() {
    for (cycle_us, ms) in [(1_000, 6), (2_000, 11), (4_000, 21)] {
        let mut fixture = fixture(cycle_us, at_limit(2), config(1, 1));
        fixture.start();
        fixture.steps(200);
        let free_ns = fixture.now_ns() + ms * MS;
        let node = occupy_bus(&fixture, ms);
        fixture.steps(4);
        fixture.cia402.quick_stop_all();
        fixture.idle(60);
        drop(node);
        let stopped = |drive: &ecan_sim::Drive| {
            let mut records = drive.trace().iter().filter(|record| record.time_ns >= free_ns);
            let stop = records.find(|record| matches!(record.event, TraceEvent::Stop { .. }));
            stop.map(|record| record.time_ns - free_ns)
        };
        let delay_ns = fixture.drive(0, stopped).expect("the drive stops");
        assert!(delay_ns < 3 * MS, "{cycle_us} us: {delay_ns} ns after the bus is free");
    }
}

/// Each target is a step limit above the last one sent.
fn accelerate(fixture: &mut Fixture, cycles: usize) {
    for _ in 0..cycles {
        if let Some(target) = fixture.cia402.target(0) {
            fixture.cia402.set_target(0, target + STEP as i32).unwrap();
        }
        fixture.cycle_with(|cia402, cycle| cia402.send_targets_all(cycle));
    }
}

/// Nothing is released late. A late frame is dropped, and the next target makes its step, too: the
/// image in the sync manager of the stalled gateway is the only one.
#[test]
fn scheduled_targets_are_not_released_late() {
    for (target_ns, sync_ns) in
        [(Some(200_000), Some(300_000)), (Some(200_000), None), (None, Some(300_000))]
    {
        for ms in [2, 6, 20] {
            let mut adapter = adapter(2_000);
            adapter.dc = Some(DcSync::new(Duration::from_millis(2), Duration::from_micros(700)));
            let traced = scenario(1, |drive| drive.trace = 100_000);
            let mut fixture = Fixture::open_with(traced, adapter, at_limit(2), config(1, 1));
            fixture.cia402.set_scheduled_tx(&fixture.port, target_ns, sync_ns).unwrap();
            fixture.start();
            let disturbed = Disturbed::run(&mut fixture, |fixture| {
                fixture.inject(stall(ms));
                None
            });
            let case = format!("{target_ns:?} {sync_ns:?} {ms} ms");
            let step = largest_step(&fixture, 0);
            assert!(step <= 2 * STEP, "{case}: {step}");
            assert!(disturbed.fastest < 2.0, "{case}: {}", disturbed.fastest);
        }
    }
}

#[test]
fn full_bus_delays_no_target() {
    for with_sdo in [false, true] {
        let mut fixture = fixture(1_000, at_limit(4), config(1, 1));
        fixture.start();
        let nodes: Vec<_> = fixture.cia402.network().handles().collect();
        for cycle in 0..1_000 {
            if with_sdo {
                // A transfer that is busy continues.
                let node = nodes[cycle % nodes.len()];
                let _ = fixture.cia402.network_mut().start_upload(node, object::IDENTITY, 1);
            }
            fixture.step();
        }
        for axis in 0..4 {
            assert_eq!(fixture.cia402.statistics(axis).waits, 0, "axis {axis}, SDO {with_sdo}");
        }
    }
}

/// The drive's own window ends the motion of released targets that its motor cannot follow.
#[test]
fn following_error_window_stops_released_targets() {
    let fastest = |window| {
        let mut table = at_limit(1);
        table[0].drive.following_error = window;
        let mut fixture = fixture(4_000, table, config(1, 1));
        fixture.start();
        let disturbed = Disturbed::run(&mut fixture, |fixture| Some(occupy_bus(fixture, 40)));
        (disturbed.fastest, fixture.cia402.drive_state(0))
    };
    let (without, state) = fastest(None);
    assert_eq!(state, Some(DriveState::OperationEnabled));
    let (with, state) = fastest(Some((STEP / 2, 0)));
    assert_eq!(state, Some(DriveState::Fault));
    assert!(with < without, "{with} {without}");
}

// Pauses of the application

#[test]
fn pause_keeps_the_limits() {
    for ms in [10, 90, 200] {
        let mut fixture = fixture(2_000, at_limit(2), config(1, 1));
        fixture.start();
        let disturbed = Disturbed::run(&mut fixture, |fixture| {
            fixture.simulation.pass_ns(ms * MS);
            None
        });
        assert!(disturbed.together <= STALLED_TOGETHER, "{ms} ms: {}", disturbed.together);
        assert!(disturbed.fastest < 1.05, "{ms} ms: {}", disturbed.fastest);
        assert!(largest_step(&fixture, 0) <= STEP, "{ms} ms");
    }
}

#[test]
fn axis_at_rest_after_a_pause_is_not_moved_by_halt() {
    let mut fixture = fixture(2_000, at_limit(1), config(1, 1));
    fixture.start();
    fixture.steps(200);
    fixture.simulation.pass_ns(50 * MS);
    let before = fixture.drive(0, ecan_sim::Drive::mechanical_position);
    fixture.cia402.halt(0).unwrap();
    fixture.idle(50);
    let after = fixture.drive(0, ecan_sim::Drive::mechanical_position);
    assert!(fixture.cia402.is_running(0) || fixture.cia402.is_at_rest(0));
    let limit = f64::from(STEP) / 5.0;
    assert!((after - before).abs() < limit, "moved by {}", after - before);
}

#[test]
fn pause_keeps_the_last_velocity_until_the_heartbeat_is_lost() {
    for (ms, is_stopped) in [(50, false), (200, false), (400, true)] {
        let axis = axis(0, 0, 1).with_mode(OperatingMode::CyclicVelocity);
        let mut fixture = fixture(2_000, vec![axis], config(1, 1));
        fixture.start();
        accelerate(&mut fixture, 100);
        fixture.idle(20);
        let before = fixture.drive(0, ecan_sim::Drive::velocity);
        assert!(before >= 99_000.0, "{before}");
        fixture.simulation.pass_ns(ms * MS);
        let after = fixture.drive(0, ecan_sim::Drive::velocity);
        assert_eq!(after == 0.0, is_stopped, "{ms} ms: {after}");
        let watch = MotorWatch::new(&fixture, 0);
        accelerate(&mut fixture, 20);
        let fastest = watch.velocities(&fixture).into_iter().fold(0.0, f64::max);
        let most = if is_stopped { 0.0 } else { before + 20.0 * f64::from(STEP) };
        assert!(fastest <= most, "{ms} ms: {fastest}");
    }
}
