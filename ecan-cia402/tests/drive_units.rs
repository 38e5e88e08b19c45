//! Limits and units of the drives: written, read back, and in force.
#![allow(missing_docs)]

use crate::axes::{Fixture, axis, scenario};
use ecan_canopen::{OperatingMode, object};
use ecan_cia402::{
    AxesSnapshot, AxisConfig, AxisError, AxisFault, Decision, ScaleFinding, ScaleSource,
};

fn fixture(config: AxisConfig) -> Fixture {
    Fixture::single(vec![config]).started()
}

#[test]
fn limits_are_written_read_back_and_in_force() {
    let mut config = axis(0, 0, 1).with_step_limit(1_000);
    config.drive.max_torque = Some(1_500);
    config.drive.max_motor_speed = Some(120);
    config.drive.write_position_limits = true;
    config.bounds = Some((-30_000, 40_000));
    let mut fixture = fixture(config);
    let value = |index, subindex| fixture.drive(0, |drive| drive.object(index, subindex));
    assert_eq!(value(object::MAX_TORQUE, 0), Some(1_500));
    assert_eq!(value(object::MAX_MOTOR_SPEED, 0), Some(120));
    assert_eq!(value(object::SOFTWARE_POSITION_LIMIT, 1), Some(-30_000));
    let limits = fixture.axis(0).drive().limits.unwrap();
    assert_eq!((limits.max_torque, limits.max_motor_speed), (Some(1_500), Some(120)));
    assert_eq!(limits.position, Some((-30_000, 40_000)));
    // Two revolutions per second in 2 ms.
    assert_eq!(fixture.axis(0).guard().limits().step, 262);
    let target = fixture.axis(0).target().unwrap();
    for (step, is_allowed) in [(263, false), (262, true)] {
        fixture.axis_mut(0).set_target(target + step).unwrap();
        fixture.idle(1);
        let decision = fixture.axis(0).decision();
        assert_eq!(matches!(decision, Decision::Target(_)), is_allowed, "{decision:?}");
    }
    fixture.check();
}

#[test]
fn limits_of_the_drive_narrow_those_of_the_axis() {
    let mut config = axis(0, 0, 1).with_mode(OperatingMode::CyclicTorque);
    config.drive.use_limits = true;
    config.bounds = Some((-5_000, 200));
    let fixture = fixture(config);
    // 0x6072 of the simulated drive is 3000.
    assert_eq!(fixture.axis(0).guard().limits().bounds, Some((-3_000, 200)));
    assert_eq!(fixture.axis(0).config().bounds, Some((-5_000, 200)));
}

#[test]
fn limit_that_the_drive_does_not_have_fails_the_configuration() {
    let mut config = axis(0, 0, 1);
    config.drive.max_motor_speed = Some(100);
    let scenario = scenario(1, |drive| drive.quirks.missing.push(object::MAX_MOTOR_SPEED));
    let mut fixture = Fixture::with(scenario, vec![config]);
    fixture.axis_mut(0).configure().unwrap();
    fixture.idle(500);
    let error = fixture.axis(0).error().unwrap();
    assert!(matches!(error, AxisError::Setup(_)), "{error}");
    assert!(error.to_string().contains("0x6080"), "{error}");
}

#[test]
fn different_scale_is_reported() {
    let mut config = axis(0, 0, 1);
    config.scale_source = ScaleSource::Checked;
    config.scale = ecan_cia402::Scale::steps_per_turn(-65_536.0).with_velocity_units(65_536.0);
    let same = fixture(config.clone());
    assert_eq!(same.cia402.axis(0).unwrap().drive().scale_finding, None);
    assert_eq!(
        same.cia402.axis(0).unwrap().drive().units.unwrap().steps_per_turn(),
        Some(65_536.0)
    );
    config.scale = ecan_cia402::Scale::steps_per_turn(360.0);
    let other = fixture(config);
    let expected = ScaleFinding::StepsPerTurn { configured: 360.0, drive: 65_536.0 };
    assert_eq!(other.cia402.axis(0).unwrap().drive().scale_finding, Some(expected));
    assert_eq!(
        other.cia402.axis(0).unwrap().config().scale.steps(),
        360.0,
        "the configuration counts"
    );
    // A table without the choice reads nothing.
    let plain = fixture(axis(0, 0, 1));
    assert_eq!(
        (
            plain.cia402.axis(0).unwrap().drive().units,
            plain.cia402.axis(0).unwrap().drive().scale_finding
        ),
        (None, None)
    );
}

#[test]
fn scale_of_the_drive_is_used_where_chosen() {
    let mut config = axis(0, 0, 1);
    config.scale_source = ScaleSource::Drive;
    config.scale = config.scale.with_origin(1_000);
    let mut fixture = fixture(config.clone());
    let observer = fixture.port.adapter().observer();
    let mut snapshot = observer.snapshot();
    fixture.idle(2);
    let scale = fixture.axis(0).config().scale;
    assert_eq!((scale.steps(), scale.velocity_units()), (65_536.0, Some(65_536.0)));
    let actual = fixture.axis(0).actual().unwrap();
    let degrees = f64::from(actual - 1_000) / 65_536.0 * 360.0;
    assert_eq!(fixture.axis(0).status().actual_degrees(), Some(degrees));
    snapshot.update().unwrap();
    let status = AxesSnapshot::of(&snapshot).unwrap().axis(0).unwrap();
    assert_eq!(status.actual_degrees(), Some(degrees));
    // A drive without encoder resolution.
    let scenario = scenario(1, |drive| drive.quirks.missing.push(object::ENCODER_RESOLUTION));
    let mut without = Fixture::with(scenario, vec![config.clone()]);
    without.cia402.axis_mut(0).unwrap().configure().unwrap();
    without.idle(500);
    let error = without.cia402.axis(0).unwrap().error().unwrap();
    assert!(error.to_string().contains("0x608F"), "{error}");
    config.limits.velocity = Some(1.0);
    let mut faults = Vec::new();
    config.check(&mut |fault| faults.push(fault));
    assert_eq!(faults, [AxisFault::ScaleSource]);
}
