//! Limits as the drive executes them: judged by the drive's own record of its targets, and by the
//! velocity of its motor in each controller period.
#![allow(missing_docs)]

mod axes;

use std::time::Duration;

use axes::{Fixture, axes, axis, scenario};
use ecan_canopen::{OperatingMode, SyncConfig, object};
use ecan_cia402::{
    AxisConfig, AxisFault, Cia402, Cia402Config, Cia402Error, CommandError, Decision, WaitReason,
};
use ecan_host::AdapterConfig;
use ecan_mcan_port::{ChannelConfig, Cycle, GatewayConfig, Port, PortConfig, SendOptions};
use ecan_protocol::can::{CanFrame, CanId};
use ecan_sim::{ClockKind, Fault, LossDirection, SimOptions, TraceEvent};

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

    fn range(&self, fixture: &Fixture) -> (f64, f64) {
        let velocities = self.velocities(fixture);
        assert!(!velocities.is_empty());
        let fold = |(low, high): (f64, f64), v: &f64| (low.min(*v), high.max(*v));
        velocities.iter().fold((f64::MAX, f64::MIN), fold)
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
            fixture.until(5_000, |cia402| cia402.phase(0) == Some(ecan_cia402::AxisPhase::Standby));
            fixture.cia402.enable(0).unwrap();
            fixture.until(2_000, Cia402::all_running);
            fixture.steps(40);
            fixture.cia402.halt(0).unwrap();
            fixture.until(1_000, |cia402| cia402.is_at_rest(0));
            fixture.cia402.disable(0).unwrap();
            fixture.until(2_000, |cia402| {
                cia402.drive_state(0) == Some(ecan_canopen::DriveState::SwitchOnDisabled)
            });
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
    for seed in 1..=8_u64 {
        let mut fixture = fixture(2_000, at_limit(2), config(1, 1));
        fixture.start();
        let mut random = seed.wrapping_mul(0x9E37_79B9_7F4A_7C15);
        let mut draw = |bound: u64| {
            random ^= random << 13;
            random ^= random >> 7;
            random ^= random << 17;
            random % bound
        };
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
