//! Targets in each target period of several SYNC periods (`motion_div`), as the drive executes them.
#![allow(missing_docs)]

use std::time::Duration;

use crate::axes::{Fixture, axis};
use crate::support::limits::{MS, MotorWatch, STEP, at_limit, config, fixture, largest_step};
use ecan_canopen::{DriveState, OperatingMode, object};
use ecan_cia402::{
    AxisCommand, AxisConfig, AxisFault, AxisPhase, Cia402, Cia402Error, CommandError, HomingConfig,
    StopKind,
};
use ecan_host::AdapterConfig;
use ecan_mcan_port::{ChannelConfig, Cycle, GatewayConfig, Port, PortConfig};
use ecan_sim::{ClockKind, DriveFault, SimOptions};

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
        let statistics = fixture.axis(0).statistics();
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

type Calls = fn(&mut Cia402, &mut Cycle<'_>);

/// Calls of an application in one cycle of the Port, with a target a step limit beyond the last one.
const REPEATED_CALLS: [(&str, Calls); 5] = [
    ("everything twice", |cia402, cycle| {
        for _ in 0..2 {
            cia402.process_rx(cycle);
            request_step(cia402);
            cia402.send_targets_all(cycle);
        }
    }),
    ("targets twice", |cia402, cycle| {
        cia402.process_rx(cycle);
        for _ in 0..2 {
            request_step(cia402);
            cia402.send_targets_all(cycle);
        }
    }),
    ("step twice, received twice", |cia402, cycle| {
        for _ in 0..2 {
            cia402.process_rx(cycle);
            cia402.send_target_step(cycle);
        }
    }),
    ("step and target", |cia402, cycle| {
        cia402.process_rx(cycle);
        cia402.send_target_step(cycle);
        cia402.process_rx(cycle);
        request_step(cia402);
        cia402.send_targets_all(cycle);
    }),
    ("network twice", |cia402, cycle| {
        cia402.process_rx(cycle);
        request_step(cia402);
        cia402.send_targets_all(cycle);
        let now_ns = cycle.adapter().clock().now_ns();
        cia402.network_mut().receive(cycle, now_ns, |_| {});
        cia402.network_mut().send_sync(cycle);
        cia402.serve(cycle);
    }),
];

fn request_step(cia402: &mut Cia402) {
    if let Some(last) = cia402.axis(0).unwrap().target() {
        cia402.axis_mut(0).unwrap().set_target(last + STEP as i32).unwrap();
    }
}

#[test]
fn repeated_calls_in_a_cycle_keep_the_step_limit() {
    for (motion_div, every_cycles, target_cycles) in [(1, 1, 1), (1, 2, 2), (3, 1, 3)] {
        for (name, calls) in REPEATED_CALLS {
            let case = format!("{name}, motion_div {motion_div}, SYNC in every {every_cycles}");
            let mut fixture = fixture(1_000, at_limit(1), config(motion_div, every_cycles));
            fixture.start();
            let syncs = |fixture: &Fixture| fixture.cia402.network().statistics().syncs_sent;
            let run = |fixture: &mut Fixture| {
                for _ in 0..400 {
                    let mut cycle = fixture.port.next_cycle();
                    calls(&mut fixture.cia402, &mut cycle);
                }
            };
            // The motor overshoots while it reaches the speed.
            run(&mut fixture);
            let before = syncs(&fixture);
            let watch = MotorWatch::new(&fixture, 0);
            run(&mut fixture);
            let (slowest, fastest) = watch.range(&fixture);
            let speed = f64::from(STEP) * 1_000.0 / f64::from(target_cycles);
            let is_even = slowest > 0.98 * speed && fastest < 1.02 * speed;
            assert!(is_even, "{case}: {slowest}..{fastest}");
            let sent = syncs(&fixture) - before;
            assert_eq!(sent, 400 / u64::from(every_cycles), "{case}");
            assert!(fixture.axis(0).is_running(), "{case}");
        }
    }
}

#[test]
fn first_target_takes_effect_before_the_second() {
    for every_cycles in 1..=4 {
        let mut fixture = fixture(1_000, at_limit(1), config(1, every_cycles));
        for _ in 0..3 {
            fixture.cia402.command_all(AxisCommand::Configure).unwrap();
            fixture.until(5_000, |cia402| cia402.axis(0).unwrap().phase() == AxisPhase::Standby);
            fixture.axis_mut(0).enable().unwrap();
            fixture.until(2_000, Cia402::all_running);
            fixture.steps(40);
            fixture.axis_mut(0).halt();
            fixture.until(1_000, |cia402| cia402.axis(0).unwrap().is_at_rest());
            fixture.axis_mut(0).stop(StopKind::Disable);
            fixture.until(2_000, |cia402| {
                cia402.axis(0).unwrap().drive_state() == Some(DriveState::SwitchOnDisabled)
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

/// Set-points, mode change, homing and fault reset need several frames in a row.
#[test]
fn procedures_work_in_longer_target_periods() {
    for (motion_div, every_cycles) in [(4, 1), (1, 2), (3, 2), (1, 4)] {
        let profile = axis(0, 0, 1).with_mode(OperatingMode::ProfilePosition);
        let mut fixture = fixture(1_000, vec![profile], config(motion_div, every_cycles));
        fixture.start();
        let from = fixture.axis(0).target().unwrap();
        for goal in [from + 5_000, from - 3_000] {
            fixture.axis_mut(0).set_target(goal).unwrap();
            fixture.until(2_000, |cia402| cia402.axis(0).unwrap().is_target_reached());
            let position = fixture.drive(0, ecan_sim::Drive::position);
            assert!((position - goal).abs() < 100, "{position} {goal}");
        }
        fixture.axis_mut(0).change_mode(OperatingMode::CyclicPosition).unwrap();
        fixture.until(5_000, |cia402| {
            cia402.axis(0).unwrap().is_running()
                && cia402.axis(0).unwrap().mode() == OperatingMode::CyclicPosition
        });
        fixture.axis_mut(0).set_target_step(500);
        fixture.steps(400);
        let case = format!("motion_div {motion_div}, SYNC in every {every_cycles}");
        assert!(fixture.axis(0).is_running(), "{case}");
        let steps: Vec<_> =
            fixture.history(0).iter().rev().take(50).map(ecan_sim::TargetRecord::step).collect();
        assert_eq!(steps, [500; 50], "{case}");
        fixture.axis_mut(0).home(HomingConfig::new(35)).unwrap();
        fixture.idle(1);
        fixture.until(20_000, Cia402::all_running);
        fixture.strike(0, DriveFault::Error { code: 0x2310 });
        fixture.until(1_000, |cia402| cia402.axis(0).unwrap().phase() == AxisPhase::Fault);
        fixture.axis_mut(0).reset_fault().unwrap();
        fixture.until(1_000, |cia402| {
            cia402.axis(0).unwrap().drive_state() == Some(DriveState::SwitchOnDisabled)
        });
        fixture.axis_mut(0).enable().unwrap();
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
    let rejected = cia402.axis_mut(0).unwrap().change_mode(OperatingMode::CyclicPosition);
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
    fixture.axis_mut(1).configure().unwrap();
    let configured = Err(CommandError::Configured { axis: 1 });
    assert_eq!(fixture.cia402.set_motion_div(1), configured);
    fixture.start();
    assert_eq!(fixture.cia402.set_motion_div(1), Err(CommandError::Configured { axis: 0 }));
    fixture.steps(400);
    let before = fixture.axis(0).statistics().targets_sent;
    fixture.steps(400);
    assert_eq!(fixture.axis(0).statistics().targets_sent, before + 200);
}
