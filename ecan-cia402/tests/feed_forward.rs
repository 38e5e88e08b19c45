//! Feed-forward of velocity and torque with the targets: effect at the motor, limits, end.
#![allow(missing_docs)]

use std::time::Duration;

use crate::axes::{Fixture, axis, scenario};
use ecan_canopen::{DriveState, OperatingMode, QuickStopOption, SyncConfig, object};
use ecan_cia402::{
    AxisCommand, AxisConfig, AxisPhase, Cia402, Cia402Config, FeedForward, FeedForwardLimits,
    OutputObject, Scale, StopKind, Target,
};
use ecan_host::AdapterConfig;
use ecan_sim::{Fault, LossDirection};

/// Increments per target of the test motion: 100,000 increments/s at a target period of 2 ms.
const STEP: i32 = 200;
const VELOCITY: i32 = 100_000;

fn forward(velocity: i32, torque: i16) -> FeedForward {
    FeedForward { velocity, torque }
}

fn config() -> AxisConfig {
    let mut axis = axis(0, 0, 1).with_step_limit(STEP as u32);
    axis.pdos.outputs = vec![OutputObject::VelocityOffset, OutputObject::TorqueOffset];
    axis.feed_forward = FeedForwardLimits {
        velocity: VELOCITY as u32,
        velocity_change: 5_000,
        torque: 100,
        torque_change: 10,
    };
    axis
}

/// A drive without its own feed-forward of the velocity.
fn fixture(config: AxisConfig) -> Fixture {
    let scenario = scenario(1, |drive| drive.motor.feed_forward = 0);
    Fixture::with(scenario, vec![config]).started()
}

/// Moves the axis by `step` per cycle, with a feed-forward.
fn travel(fixture: &mut Fixture, cycles: usize, step: i32, forward: Option<FeedForward>) {
    for _ in 0..cycles {
        fixture.cycle_with(|cia402, cycle| {
            if let Some(target) = cia402.axis(0).unwrap().target() {
                let target = target + step;
                match forward {
                    Some(forward) => cia402
                        .axis_mut(0)
                        .unwrap()
                        .set_target(Target::from(target).with_feed_forward(forward))
                        .unwrap(),
                    None => cia402.axis_mut(0).unwrap().set_target(target).unwrap(),
                }
            }
            cia402.send_targets_all(cycle);
        });
    }
}

fn offsets(fixture: &Fixture) -> (i64, i64) {
    fixture.drive(0, |drive| {
        let value = |index| drive.object(index, 0).unwrap();
        (value(object::VELOCITY_OFFSET), value(object::TORQUE_OFFSET))
    })
}

/// Ramps the velocity up, so that the motor can follow, and returns the following error at the end.
fn following_error(fixture: &mut Fixture, gives: bool) -> i32 {
    for step in (0..=STEP).step_by(5) {
        travel(fixture, 1, step, gives.then(|| forward(step * 500, 0)));
    }
    travel(fixture, 200, STEP, gives.then(|| forward(VELOCITY, 0)));
    fixture.drive(0, |drive| drive.following_error())
}

#[test]
fn velocity_feed_forward_removes_the_following_error() {
    let without = following_error(&mut fixture(config()), false);
    // 100,000 increments/s over a gain of 200/s.
    assert!((450..550).contains(&without), "{without}");
    let mut fixture = fixture(config());
    let with = following_error(&mut fixture, true);
    assert!(with.abs() < 20, "{with}");
    assert_eq!(offsets(&fixture), (VELOCITY.into(), 0));
    assert_eq!(fixture.axis(0).status().feed_forward, forward(VELOCITY, 0));
    assert_eq!(fixture.axis(0).status().feed_forward, forward(VELOCITY, 0));
    assert_eq!(fixture.axis(0).statistics().feed_forwards_limited, 0);
    fixture.check();
}

#[test]
fn feed_forward_is_limited_and_ramped() {
    let mut fixture = fixture(config());
    travel(&mut fixture, 100, 0, Some(forward(i32::MAX, i16::MIN)));
    assert_eq!(offsets(&fixture), (VELOCITY.into(), -100));
    assert!(fixture.axis(0).statistics().feed_forwards_limited > 90);
    // Targets without a feed-forward.
    travel(&mut fixture, 1, 0, None);
    assert_eq!(fixture.axis(0).status().feed_forward, forward(VELOCITY - 5_000, -90));
    travel(&mut fixture, 40, 0, None);
    assert_eq!(offsets(&fixture), (0, 0));
    fixture.check();
}

#[test]
fn repeated_target_has_no_feed_forward() {
    let mut fixture = fixture(config());
    travel(&mut fixture, 50, 0, Some(forward(50_000, 50)));
    assert_eq!(offsets(&fixture), (50_000, 50));
    // The application stalls.
    fixture.idle(40);
    assert_eq!(offsets(&fixture), (0, 0));
    assert!(fixture.axis(0).is_running());
}

#[test]
fn rejected_target_and_halt_end_the_feed_forward() {
    let mut fixture = fixture(config());
    travel(&mut fixture, 50, 10, Some(forward(5_000, 50)));
    travel(&mut fixture, 40, STEP + 1, Some(forward(50_000, 50)));
    assert_eq!(offsets(&fixture), (0, 0), "the targets are rejected");
    travel(&mut fixture, 50, 10, Some(forward(5_000, 50)));
    assert_eq!(offsets(&fixture), (5_000, 50));
    fixture.axis_mut(0).halt();
    travel(&mut fixture, 40, 10, Some(forward(5_000, 50)));
    assert_eq!(offsets(&fixture), (0, 0), "the host moves the axis");
    assert!(fixture.axis(0).is_at_rest());
    fixture.check();
}

#[test]
fn hold_ends_the_feed_forward_when_the_path_returns() {
    let mut fixture = fixture(config());
    travel(&mut fixture, 100, 10, Some(forward(50_000, 50)));
    assert_eq!(offsets(&fixture), (50_000, 50));
    fixture.inject(Fault::LostFrame { direction: LossDirection::Outward, cycles: 6 });
    travel(&mut fixture, 30, 10, Some(forward(50_000, 50)));
    assert!(matches!(fixture.axis(0).phase(), AxisPhase::Holding(_)));
    assert_eq!(fixture.drive(0, |drive| drive.state()), DriveState::OperationEnabled);
    assert_eq!(offsets(&fixture), (0, 0), "without a command, while the drive is enabled");
    let resting = fixture.drive(0, |drive| drive.targets().sums().followed);
    travel(&mut fixture, 30, 10, Some(forward(50_000, 50)));
    assert_eq!(fixture.drive(0, |drive| drive.targets().sums().followed), resting, "no target");
    fixture.axis_mut(0).enable().unwrap();
    fixture.until(2_000, Cia402::all_running);
    fixture.check();
}

#[test]
fn first_target_waits_for_the_end_of_the_feed_forward() {
    let mut fixture = fixture(config());
    travel(&mut fixture, 100, 0, Some(forward(VELOCITY, 0)));
    let target = fixture.axis(0).target().unwrap();
    // 100,000 increments/s over a gain of 200/s.
    let displaced = fixture.drive(0, |drive| drive.position()) - target;
    assert!((450..550).contains(&displaced), "{displaced}");
    fixture.inject(Fault::LinkLoss { gateway: 0, for_ms: 23 });
    fixture.until(50, |cia402| !cia402.axis(0).unwrap().is_running());
    fixture.axis_mut(0).enable().unwrap();
    fixture.until(20_000, Cia402::all_running);
    let first = fixture.axis(0).target().unwrap();
    assert!(first.abs_diff(target) <= 60, "{first} after {target}");
    fixture.check();
}

#[test]
fn stop_ends_the_feed_forward_at_once() {
    let mut fixture = fixture(config());
    travel(&mut fixture, 100, 10, Some(forward(50_000, 50)));
    fixture.axis_mut(0).stop(StopKind::QuickStop);
    assert_eq!(fixture.axis(0).status().feed_forward, forward(50_000, 50), "until it is sent");
    travel(&mut fixture, 4, 10, Some(forward(50_000, 50)));
    assert_eq!(offsets(&fixture), (0, 0));
    assert_eq!(fixture.axis(0).status().feed_forward, FeedForward::NONE);
}

/// Stops an axis that is at rest, but not at its target, after a number of lost frames.
fn stop_at_rest(lost_cycles: u32) {
    let mut config = config();
    config.drive.quick_stop = Some(QuickStopOption::QuickStopAndStay);
    let scenario = scenario(1, |drive| drive.motor.feed_forward = 0);
    let adapter = AdapterConfig::new(1).with_cycle(Duration::from_millis(1));
    let sync = SyncConfig { every_cycles: 2, ..SyncConfig::default() };
    let settings = Cia402Config { sync, ..Cia402Config::default() };
    let mut fixture = Fixture::open_with(scenario, adapter, vec![config], settings).started();
    travel(&mut fixture, 200, 0, Some(forward(VELOCITY, 0)));
    assert!(fixture.drive(0, |drive| drive.velocity()).abs() < 10.0);
    // The end of the feed-forward does not arrive before the stop, which goes out by SDO, too.
    fixture.inject(Fault::NodeSilent { node: "drive 0.0/1".to_owned(), for_ms: 200 });
    fixture.idle(199);
    fixture.inject(Fault::LostFrame { direction: LossDirection::Outward, cycles: lost_cycles });
    fixture.idle(1);
    fixture.cia402.command_all(AxisCommand::Stop(StopKind::QuickStopThenDisable)).unwrap();
    let mut is_braking = false;
    for _ in 0..20_000 {
        fixture.idle(1);
        let (state, velocity) = fixture.drive(0, |drive| (drive.state(), drive.velocity()));
        is_braking |= state == DriveState::QuickStopActive;
        if state == DriveState::SwitchOnDisabled {
            assert!(is_braking && velocity.abs() < 1_000.0, "{lost_cycles}: {velocity}");
            return;
        }
    }
    panic!("{lost_cycles}: not off: {:?}", fixture.axis(0).progress());
}

#[test]
fn voltage_stays_while_the_motor_returns_to_its_target() {
    (2..12).step_by(3).for_each(stop_at_rest);
}

#[test]
fn velocity_limit_of_the_axis_limits_the_feed_forward() {
    let mut config = config();
    config.scale = Scale::steps_per_turn(65_536.0).with_velocity_units(65_536.0);
    config.limits.velocity = Some(30_000.0 / 65_536.0 * std::f64::consts::TAU);
    let mut fixture = fixture(config);
    travel(&mut fixture, 100, 0, Some(forward(VELOCITY, 0)));
    // 60 increments in 2 ms, rounded down.
    let (velocity, _) = offsets(&fixture);
    assert!((29_000..=30_000).contains(&velocity), "{velocity}");
}

#[test]
fn configuration_clears_offsets_of_an_earlier_owner() {
    let mut fixture = fixture(config());
    travel(&mut fixture, 100, 10, Some(forward(50_000, 50)));
    let table = Cia402::new(&fixture.port, vec![config()], Cia402Config::default());
    fixture.cia402 = table.unwrap();
    assert_eq!(offsets(&fixture), (50_000, 50));
    fixture.start();
    assert_eq!(offsets(&fixture), (0, 0));
    assert_eq!(fixture.drive(0, |drive| drive.targets().sums().firsts), 2);
    assert_eq!(fixture.drive(0, |drive| drive.targets().sums().firsts_with_offsets), 0);
}

#[test]
fn torque_feed_forward_accelerates_a_velocity_axis() {
    let mut config = config().with_mode(OperatingMode::CyclicVelocity);
    config.pdos.outputs = vec![OutputObject::TorqueOffset];
    let mut fixture = fixture(config);
    travel(&mut fixture, 100, 0, Some(forward(77, 100)));
    assert_eq!(offsets(&fixture), (0, 100), "the velocity offset is not mapped");
    // 100 thousandths are 6,670,000 increments/s^2; the controller, which compensates friction,
    // corrects after its period of 1 ms.
    let velocity = fixture.drive(0, |drive| drive.velocity());
    assert!((6_000.0..7_000.0).contains(&velocity), "{velocity}");
    travel(&mut fixture, 40, 0, None);
    assert!(fixture.drive(0, |drive| drive.velocity()).abs() < 10.0);
}
