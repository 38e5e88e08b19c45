//! The modes IP, PT and VL.
#![allow(missing_docs)]

use crate::axes::{Fixture, axis};
use ecan_canopen::{DriveState, OperatingMode, Statusword, object};
use ecan_cia402::{AxisConfig, AxisPhase, Cia402, Decision, HoldReason, StopKind, VlConfig};
use ecan_sim::{Fault, LossDirection};

fn in_mode(mode: OperatingMode, change: impl FnOnce(&mut AxisConfig)) -> Fixture {
    let mut config = axis(0, 0, 1).with_mode(mode);
    change(&mut config);
    Fixture::single(vec![config]).started()
}

fn velocity(fixture: &Fixture) -> f64 {
    fixture.drive(0, |drive| drive.velocity())
}

#[test]
fn interpolated_position_follows_like_csp() {
    let mut fixture = in_mode(OperatingMode::InterpolatedPosition, |config| {
        *config = config.clone().with_target_step(200);
        config.ramp = 20;
    });
    fixture.idle(5);
    let status = fixture.axis(0).status().statusword.unwrap();
    assert!(status.has(Statusword::MODE_12), "the interpolation is active: {status:?}");
    fixture.steps(300);
    assert!((velocity(&fixture) - 100_000.0).abs() < 2_000.0, "{}", velocity(&fixture));
    let lag = fixture.axis(0).following_error().unwrap();
    assert!(lag.abs() < 2_000, "{lag}");
    fixture.axis_mut(0).halt();
    fixture.steps(200);
    assert!(fixture.axis(0).is_at_rest());
    let target = fixture.axis(0).target().unwrap();
    assert_eq!(fixture.axis(0).actual(), Some(target));
    let far = target + 100_000;
    fixture.axis_mut(0).resume();
    fixture.axis_mut(0).set_target(far).unwrap();
    fixture.idle(1);
    assert!(matches!(fixture.axis(0).decision(), Decision::Reject(_)));
    fixture.check();
}

#[test]
fn interpolated_motion_ends_at_the_last_target_after_a_hold() {
    let mut fixture = in_mode(OperatingMode::InterpolatedPosition, |config| {
        *config = config.clone().with_target_step(200);
        config.drive.interpolation_buffer = Some(4);
    });
    assert_eq!(
        fixture.drive(0, |drive| drive.object(object::INTERPOLATION_BUFFER, 2)),
        Some(4),
        "buffer size"
    );
    fixture.steps(100);
    fixture.inject(Fault::LostFrame { direction: LossDirection::Outward, cycles: 6 });
    fixture.steps(30);
    assert_eq!(
        fixture.axis(0).phase(),
        AxisPhase::Holding(HoldReason::WorkingCounter),
        "{:?}",
        fixture.axis(0).progress()
    );
    let (state, demand) = fixture.drive(0, |drive| (drive.state(), drive.demand()));
    assert_eq!(state, DriveState::OperationEnabled);
    let last = fixture.history(0).iter().rev().find(|record| record.followed).unwrap().target;
    assert_eq!(demand, last);
    fixture.axis_mut(0).enable().unwrap();
    fixture.until(2_000, Cia402::all_running);
    fixture.check();
}

#[test]
fn interpolated_axis_stops_and_is_enabled_again() {
    let mut fixture = in_mode(OperatingMode::InterpolatedPosition, |config| {
        *config = config.clone().with_target_step(200);
    });
    fixture.steps(100);
    fixture.axis_mut(0).stop(StopKind::QuickStop);
    fixture.idle(300);
    assert!(fixture.axis(0).is_stopped());
    assert!(velocity(&fixture).abs() < 10.0);
    fixture.axis_mut(0).enable().unwrap();
    fixture.until(2_000, Cia402::all_running);
    fixture.steps(50);
    fixture.check();
}

#[test]
fn profile_torque_rises_by_its_slope() {
    let mut fixture = in_mode(OperatingMode::ProfileTorque, |config| {
        config.bounds = Some((-200, 200));
        config.drive.torque_slope = Some(1_000);
    });
    assert_eq!(fixture.axis(0).target(), Some(0));
    assert_eq!(fixture.drive(0, |drive| drive.object(object::TORQUE_SLOPE, 0)), Some(1_000));
    fixture.axis_mut(0).set_target(201).unwrap();
    fixture.idle(1);
    assert!(matches!(fixture.axis(0).decision(), Decision::Reject(_)), "beyond the bounds");
    fixture.axis_mut(0).set_target(150).unwrap();
    let mut last = 0.0;
    for _ in 0..100 {
        fixture.idle(1);
        let torque = fixture.drive(0, |drive| drive.torque());
        // 1000 thousandths per second are 2 in a cycle of 2 ms; a controller period may be between.
        assert!(torque - last <= 3.1, "{torque} after {last}");
        last = torque;
    }
    assert!((149.0..151.0).contains(&last), "{last}");
    assert!(fixture.axis(0).is_target_reached());
    assert!(velocity(&fixture) > 10_000.0);
    fixture.axis_mut(0).halt();
    fixture.idle(1_500);
    assert!(velocity(&fixture).abs() < 10.0, "{}", velocity(&fixture));
    assert_eq!(fixture.axis(0).drive_state(), Some(DriveState::OperationEnabled));
}

#[test]
fn velocity_mode_follows_its_ramps_and_limits() {
    let mut fixture = in_mode(OperatingMode::Velocity, |config| {
        config.bounds = Some((-300, 300));
        config.drive.vl = VlConfig {
            limits: Some((30, 200)),
            acceleration: Some((100, 1)),
            deceleration: Some((400, 1)),
        };
    });
    let rpm = |fixture: &Fixture| velocity(fixture) * 60.0 / 65_536.0;
    fixture.axis_mut(0).set_target(100).unwrap();
    fixture.idle(250);
    let half = rpm(&fixture);
    assert!((45.0..52.0).contains(&half), "0.5 s at 100 min^-1/s: {half}");
    fixture.idle(350);
    assert!((rpm(&fixture) - 100.0).abs() < 1.0, "{}", rpm(&fixture));
    assert!(fixture.axis(0).is_target_reached());
    fixture.axis_mut(0).set_target(300).unwrap();
    fixture.idle(1_000);
    assert!((rpm(&fixture) - 200.0).abs() < 1.0, "0x6046:02: {}", rpm(&fixture));
    fixture.axis_mut(0).set_target(1).unwrap();
    fixture.idle(1_000);
    assert!((rpm(&fixture) - 30.0).abs() < 1.0, "0x6046:01: {}", rpm(&fixture));
    fixture.axis_mut(0).stop(StopKind::QuickStop);
    fixture.idle(500);
    assert!(fixture.axis(0).is_stopped());
    assert!(velocity(&fixture).abs() < 10.0);
}

#[test]
fn holding_axis_of_velocity_and_torque_is_stopped() {
    for (mode, target) in [(OperatingMode::Velocity, 100), (OperatingMode::ProfileTorque, 100)] {
        let mut fixture = in_mode(mode, |config| config.bounds = Some((-200, 200)));
        fixture.axis_mut(0).set_target(target).unwrap();
        fixture.idle(300);
        assert!(velocity(&fixture) > 10_000.0, "{mode}: {}", velocity(&fixture));
        fixture.inject(Fault::LostFrame { direction: LossDirection::Outward, cycles: 6 });
        fixture.idle(1_000);
        assert!(!fixture.axis(0).is_running(), "{mode}");
        let (state, velocity) = fixture.drive(0, |drive| (drive.state(), drive.velocity()));
        assert_ne!(state, DriveState::OperationEnabled, "{mode}");
        assert!(velocity.abs() < 10.0, "{mode}: {velocity}");
    }
}
