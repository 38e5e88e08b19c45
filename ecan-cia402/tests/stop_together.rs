//! Stops with limits in units of a machine, and of all axes together, by the targets that the drives
//! received.
#![allow(missing_docs)]

use std::f64::consts::TAU;
use std::time::Duration;

use crate::axes::{Fixture, axes, axis};
use ecan_canopen::{OperatingMode, SyncConfig};
use ecan_cia402::{
    AxisConfig, AxisPhase, AxisRef, Cia402, Cia402Config, CommandError, Decision, HoldReason,
    MotionLimits, PathStop, Scale, TargetRejection, WaitReason,
};
use ecan_host::AdapterConfig;
use ecan_protocol::can::{CanFrame, CanId};
use ecan_sim::{DriveFault, Fault, LossDirection};
use proptest::prelude::*;

const CYCLE_S: f64 = 0.002;
const STEPS: f64 = 65_536.0;

/// Limits in increments per cycle, of acceleration and jerk.
#[derive(Debug, Clone, Copy)]
struct Limits(f64, f64);

/// Axes with limits of the velocity of 400 increments per cycle, and these.
fn limited(table: Vec<AxisConfig>, limits: &[Limits]) -> Vec<AxisConfig> {
    let limited = |(mut axis, limits): (AxisConfig, &Limits)| {
        let unit = TAU / STEPS / CYCLE_S;
        axis.scale = Scale::steps_per_turn(STEPS);
        axis.limits = MotionLimits {
            velocity: Some(400.0 * unit),
            acceleration: Some(limits.0 * unit / CYCLE_S),
            jerk: Some(limits.1 * unit / CYCLE_S / CYCLE_S),
        };
        axis
    };
    table.into_iter().zip(limits.iter().cycle()).map(limited).collect()
}

/// An application that moves its axes from rest, each at its rate times a common one, which rises by
/// 0.02 per cycle up to 1.
struct Application {
    start: Vec<i32>,
    rates: Vec<i32>,
    at: f64,
    rate: f64,
}

impl Application {
    fn new(cia402: &Cia402, rates: &[i32]) -> Self {
        let start =
            (0..rates.len()).map(|axis| cia402.axis(axis).unwrap().target().unwrap()).collect();
        Self { start, rates: rates.to_vec(), at: 0.0, rate: 0.0 }
    }

    fn cycle(&mut self, fixture: &mut Fixture) {
        self.rate = (self.rate + 0.02).min(1.0);
        self.at += self.rate;
        for (axis, (start, rate)) in self.start.iter().zip(&self.rates).enumerate() {
            let target = start + (f64::from(*rate) * self.at).round() as i32;
            fixture.axis_mut(axis).set_target(target).unwrap();
        }
        fixture.idle(1);
    }

    /// Cycles until the common rate is this one.
    fn until(&mut self, fixture: &mut Fixture, cycles: usize) {
        for _ in 0..cycles {
            self.cycle(fixture);
            assert!(
                (0..self.start.len())
                    .all(|axis| matches!(fixture.axis(axis).decision(), Decision::Target(_)))
            );
        }
    }
}

fn moving(table: Vec<AxisConfig>, rates: &[i32]) -> Fixture {
    let mut fixture = Fixture::single(table).started();
    Application::new(&fixture.cia402, rates).until(&mut fixture, 100);
    fixture
}

/// Runs until the stop has ended, and until every drive has received its targets; the state.
fn stopped(fixture: &mut Fixture) -> PathStop {
    let axes = fixture.cia402.axis_count();
    for _ in 0..2_000 {
        fixture.idle(1);
        let is_at_rest = (0..axes).all(|axis| fixture.axis(axis).is_at_rest());
        if fixture.cia402.path_stop() != PathStop::Decelerating && is_at_rest {
            fixture.idle(10);
            return fixture.cia402.path_stop();
        }
    }
    panic!(
        "{:?}: {:#?}",
        fixture.cia402.path_stop(),
        fixture.cia402.axes().map(AxisRef::progress).collect::<Vec<_>>()
    );
}

/// The targets that a drive followed, the last `count` of them.
fn targets(fixture: &Fixture, axis: usize, count: usize) -> Vec<i32> {
    let history = fixture.history(axis);
    let followed: Vec<i32> =
        history.iter().filter(|record| record.followed).map(|record| record.target).collect();
    followed[followed.len().saturating_sub(count)..].to_vec()
}

fn differences(values: &[i32]) -> Vec<i32> {
    values.windows(2).map(|pair| pair[1] - pair[0]).collect()
}

/// The targets stay on the line from `start` in the direction of the rates.
fn assert_straight(fixture: &Fixture, start: &[i32], rates: &[i32]) {
    let course = |axis: usize| {
        let course = targets(fixture, axis, usize::MAX);
        let at = course.iter().position(|target| *target == start[axis]).unwrap();
        course[at..].to_vec()
    };
    let courses: Vec<Vec<i32>> = (0..rates.len()).map(course).collect();
    let (lead, lead_rate) = rates.iter().enumerate().max_by_key(|(_, rate)| rate.abs()).unwrap();
    for (axis, course) in courses.iter().enumerate() {
        for (target, along) in course.iter().zip(&courses[lead]) {
            let along = f64::from(along - start[lead]) / f64::from(*lead_rate);
            let expected = f64::from(rates[axis]) * along;
            let error = f64::from(target - start[axis]) - expected;
            assert!(error.abs() <= 1.0, "axis {axis}: {error} at {along}");
        }
    }
}

/// From a target on, the steps change by at most the limits; each of three or four targets may be
/// rounded by a half.
fn assert_limits(fixture: &Fixture, axis: usize, start: i32, Limits(change, jerk): Limits) {
    let course = targets(fixture, axis, usize::MAX);
    let at = course.iter().position(|target| *target == start).unwrap();
    let steps = differences(&course[at.saturating_sub(3)..]);
    let changes = differences(&steps);
    for step in &changes {
        assert!(f64::from(step.abs()) <= change + 2.0, "axis {axis}: {step} {steps:?}");
    }
    for difference in differences(&changes) {
        assert!(f64::from(difference.abs()) <= jerk + 4.0, "axis {axis}: {difference} {steps:?}");
    }
}

#[test]
fn halt_keeps_the_jerk_limit() {
    for limits in [Limits(5.0, 1.0), Limits(2.5, 0.25), Limits(0.8, 0.02)] {
        let table = limited(vec![axis(0, 0, 1)], &[limits]);
        let mut fixture = moving(table, &[40]);
        let from = fixture.axis(0).target().unwrap();
        fixture.axis_mut(0).halt();
        fixture.idle(200);
        assert!(fixture.axis(0).is_at_rest());
        assert_limits(&fixture, 0, from, limits);
        let distance = fixture.axis(0).target().unwrap() - from;
        // Half the rate for rate / acceleration + acceleration / jerk, less the cycle of the call.
        let expected = 20.0 * (40.0 / limits.0 + limits.0 / limits.1 - 1.0);
        assert!((f64::from(distance) / expected - 1.0).abs() < 0.1, "{distance} {expected}");
        fixture.check();
    }
}

#[test]
fn target_beyond_the_velocity_limit_is_rejected() {
    let table = limited(vec![axis(0, 0, 1)], &[Limits(10.0, 1.0)]);
    let mut fixture = Fixture::single(table).started();
    assert_eq!(fixture.axis(0).config().step_limit, 400);
    let at = fixture.axis(0).target().unwrap();
    fixture.axis_mut(0).set_target(at + 401).unwrap();
    fixture.idle(1);
    let rejection = TargetRejection::Step { step: 401, limit: 400 };
    assert_eq!(fixture.axis(0).decision(), Decision::Reject(rejection));
    fixture.axis_mut(0).set_target(at + 400).unwrap();
    fixture.idle(1);
    assert_eq!(fixture.axis(0).decision(), Decision::Target(at + 400), "not the acceleration");
}

#[test]
fn velocity_mode_keeps_limits_in_units_of_the_drive() {
    let mut axis = axis(0, 0, 1).with_mode(OperatingMode::CyclicVelocity);
    axis.scale = Scale::steps_per_turn(STEPS).with_velocity_units(STEPS);
    // 20,000 increments/s, 200 per cycle, 10 per cycle^2.
    let unit = TAU / STEPS;
    axis.limits = MotionLimits {
        velocity: Some(20_000.0 * unit),
        acceleration: Some(200.0 * unit / CYCLE_S),
        jerk: Some(10.0 * unit / CYCLE_S / CYCLE_S),
    };
    let mut fixture = Fixture::single(vec![axis]).started();
    for n in 1..=101 {
        fixture.axis_mut(0).set_target(n * 200).unwrap();
        fixture.idle(1);
    }
    assert!(matches!(fixture.axis(0).decision(), Decision::Reject(TargetRejection::Bounds { .. })));
    assert_eq!(fixture.axis(0).target(), Some(20_000));
    fixture.axis_mut(0).set_target(19_799).unwrap();
    fixture.idle(1);
    assert!(matches!(fixture.axis(0).decision(), Decision::Reject(TargetRejection::Step { .. })));
    fixture.axis_mut(0).set_target(20_000).unwrap();
    fixture.idle(50);
    fixture.axis_mut(0).halt();
    fixture.idle(200);
    assert!(fixture.axis(0).is_at_rest());
    let targets = targets(&fixture, 0, 220);
    assert_eq!((targets[0], targets.last()), (20_000, Some(&0)));
    let steps = differences(&targets);
    assert!(steps.iter().all(|step| (-200..=0).contains(step)), "{steps:?}");
    assert!(differences(&steps).iter().all(|change| change.abs() <= 12), "{steps:?}");
}

#[test]
fn axes_stop_straight_within_their_limits() {
    let limits = [Limits(6.0, 0.5), Limits(4.0, 0.1), Limits(8.0, 2.0), Limits(4.0, 0.25)];
    for rates in [[200, 120, -75, 30], [3, -250, 250, 7], [0, 0, 17, -180], [1, 2, 3, 4]] {
        let mut fixture = moving(limited(axes(4), &limits), &rates);
        let start: Vec<i32> = (0..4).map(|axis| fixture.axis(axis).target().unwrap()).collect();
        fixture.cia402.stop_together();
        assert_eq!(stopped(&mut fixture), PathStop::Done);
        assert_straight(&fixture, &start, &rates);
        for (axis, limits) in limits.iter().enumerate() {
            assert_limits(&fixture, axis, start[axis], *limits);
            assert_eq!(fixture.axis(axis).phase(), AxisPhase::Halted);
        }
        fixture.check();
    }
}

#[test]
fn limits_follow_the_target_period() {
    let table = limited(axes(2), &[Limits(4.0, 0.25)]);
    let config = Cia402Config {
        sync: SyncConfig { every_cycles: 2, ..SyncConfig::default() },
        motion_div: 3,
        ..Cia402Config::default()
    };
    let adapter = AdapterConfig::new(1).with_cycle(Duration::from_millis(2));
    let mut fixture = Fixture::open_with(ecan_sim::drives(1, 4), adapter, table, config);
    assert_eq!(fixture.axis(0).config().step_limit, 1_600, "4 cycles");
    let error = fixture.cia402.set_motion_div(20_000).unwrap_err();
    assert!(matches!(error, CommandError::TargetPeriod { .. }), "{error}");
    fixture.cia402.set_motion_div(2).unwrap();
    assert_eq!(fixture.axis(0).config().step_limit, 800);
    fixture.start();

    let mut application = Application::new(&fixture.cia402, &[300, -200]);
    for _ in 0..200 {
        application.cycle(&mut fixture);
        // Targets are due in every second cycle.
        fixture.idle(1);
    }
    let start: Vec<i32> = (0..2).map(|axis| fixture.axis(axis).target().unwrap()).collect();
    fixture.cia402.stop_together();
    assert_eq!(stopped(&mut fixture), PathStop::Done);
    assert_straight(&fixture, &start, &[300, -200]);
    for (axis, start) in start.into_iter().enumerate() {
        // Per period of 2 cycles.
        assert_limits(&fixture, axis, start, Limits(16.0, 2.0));
    }
    fixture.check();
}

#[test]
fn slowest_axis_sets_the_duration() {
    // Axis 1 alone takes 100 / 2 + 2 / 0.1 cycles, and 100 / 2 without a limit of its jerk.
    for (has_jerk, expected) in [(true, 68..=74), (false, 48..=53)] {
        let mut table = limited(axes(2), &[Limits(50.0, 10.0), Limits(2.0, 0.1)]);
        if !has_jerk {
            table.iter_mut().for_each(|axis| axis.limits.jerk = None);
        }
        let mut fixture = moving(table, &[100, 100]);
        fixture.cia402.stop_together();
        let mut cycles = 0;
        while fixture.cia402.path_stop() == PathStop::Decelerating && cycles < 200 {
            fixture.idle(1);
            cycles += 1;
        }
        assert!(expected.contains(&cycles), "{cycles}, jerk limit: {has_jerk}");
        assert_eq!(fixture.cia402.path_stop(), PathStop::Done);
    }
}

#[test]
fn stop_from_an_acceleration_continues_it() {
    let limits = [Limits(6.0, 0.25), Limits(6.0, 0.25)];
    let rates = [200, -100];
    let mut fixture = Fixture::single(limited(axes(2), &limits)).started();
    // The rates rise by 4 and 2 per cycle.
    Application::new(&fixture.cia402, &rates).until(&mut fixture, 25);
    let start: Vec<i32> = (0..2).map(|axis| fixture.axis(axis).target().unwrap()).collect();
    fixture.cia402.stop_together();
    assert_eq!(stopped(&mut fixture), PathStop::Done);
    let after = |fixture: &Fixture, axis: usize| {
        let course = targets(fixture, axis, 200);
        let at = course.iter().position(|target| *target == start[axis]).unwrap();
        course[at..].to_vec()
    };
    let steps = differences(&after(&fixture, 0));
    assert!(steps.iter().max() > Some(&110), "it still accelerates: {steps:?}");
    assert_limits(&fixture, 0, start[0], limits[0]);
    assert_limits(&fixture, 1, start[1], limits[1]);
    for (lead, other) in after(&fixture, 0).iter().zip(after(&fixture, 1)) {
        let expected = -f64::from(lead - start[0]) / 2.0;
        assert!((f64::from(other - start[1]) - expected).abs() <= 1.0);
    }
}

#[test]
fn stop_from_a_curve_continues_straight() {
    let limits = [Limits(4.0, 0.5), Limits(4.0, 0.5)];
    let mut fixture = Fixture::single(limited(axes(2), &limits)).started();
    let start: Vec<i32> = (0..2).map(|axis| fixture.axis(axis).target().unwrap()).collect();
    // A circle of 5,000 increments at 100 increments per cycle, from rest.
    let (mut angle, mut rate) = (0.0_f64, 0.0_f64);
    for _ in 0..150 {
        rate = (rate + 0.000_4).min(0.02);
        angle += rate;
        let point = [5_000.0 * (1.0 - angle.cos()), 5_000.0 * angle.sin()];
        for (axis, value) in point.iter().enumerate() {
            fixture.axis_mut(axis).set_target(start[axis] + value.round() as i32).unwrap();
        }
        fixture.idle(1);
    }
    let start: Vec<i32> = (0..2).map(|axis| fixture.axis(axis).target().unwrap()).collect();
    let direction = [100.0 * angle.sin(), 100.0 * angle.cos()];
    fixture.cia402.stop_together();
    assert_eq!(stopped(&mut fixture), PathStop::Done);
    let end: Vec<f64> =
        (0..2).map(|axis| f64::from(fixture.axis(axis).target().unwrap() - start[axis])).collect();
    let [along, across] = [
        (end[0] * direction[0] + end[1] * direction[1]) / 100.0,
        (end[0] * direction[1] - end[1] * direction[0]) / 100.0,
    ];
    assert!(along > 1_000.0 && across.abs() < along * 0.03, "{along} {across}");
}

/// Follows a stop of two axes, the second at 0.6 times the rate of the first, in which `disturb` acts
/// in every 20th cycle. Returns the number of cycles in which an axis waited for the other.
fn disturbed_stop(fixture: &mut Fixture, disturb: impl Fn(&mut Fixture)) -> usize {
    let rates = [150, 90];
    Application::new(&fixture.cia402, &rates).until(fixture, 100);
    let start: Vec<i32> = (0..2).map(|axis| fixture.axis(axis).target().unwrap()).collect();
    fixture.cia402.stop_together();
    let mut waits = 0;
    for n in 0..300 {
        if n % 20 == 10 {
            disturb(fixture);
        } else {
            fixture.idle(1);
        }
        let waits_together =
            |axis| fixture.axis(axis).decision() == Decision::Wait(WaitReason::Together);
        waits += usize::from((0..2).any(waits_together));
        let [lead, other] = [0, 1].map(|axis| fixture.axis(axis).target().unwrap() - start[axis]);
        assert!((f64::from(lead) * 0.6 - f64::from(other)).abs() <= 1.0, "{lead} {other}");
    }
    assert_eq!(fixture.cia402.path_stop(), PathStop::Done);
    assert_straight(fixture, &start, &rates);
    waits
}

#[test]
fn incomplete_working_counter_keeps_the_path() {
    let table = limited(vec![axis(0, 0, 1), axis(1, 0, 1)], &[Limits(4.0, 0.25)]);
    let adapter = AdapterConfig::new(2).with_cycle(Duration::from_millis(2));
    let mut fixture = Fixture::open(ecan_sim::drives(2, 4), adapter, table).started();
    disturbed_stop(&mut fixture, |fixture| {
        fixture.inject(Fault::WorkingCounterOffset { offset: -1, cycles: 1 });
        fixture.idle(1);
    });
}

#[test]
fn axis_that_gets_no_target_stops_the_others_on_the_path() {
    let table = limited(vec![axis(0, 0, 1), axis(0, 1, 1)], &[Limits(4.0, 0.25)]);
    let mut fixture = Fixture::single(table).started();
    let frame = CanFrame::classic(CanId::standard(0x7FE).unwrap(), &[0; 8]).unwrap();
    let waits = disturbed_stop(&mut fixture, |fixture| {
        // The image has no space left for the channel of the second axis.
        fixture.cycle_with(|cia402, cycle| {
            cia402.send_targets_all(cycle);
            let channel = cycle.channel(0, 1).unwrap();
            while cycle.send(channel, &frame).is_ok() {}
        });
    });
    assert!(waits > 0);
}

/// A cycle in which nothing was received has no targets for any axis.
#[test]
fn cycle_without_input_keeps_the_path() {
    let table = limited(axes(2), &[Limits(4.0, 0.25)]);
    let mut fixture = Fixture::single(table).started();
    disturbed_stop(&mut fixture, |fixture| fixture.skip(1, true));
}

proptest! {
    #![proptest_config(ProptestConfig {
        cases: crate::axes::cases(16),
        failure_persistence: None,
        max_shrink_iters: 200,
        ..ProptestConfig::default()
    })]

    /// Any rates and limits, with cycles in which images are lost or have no space on a channel.
    #[test]
    fn disturbed_stop_stays_straight_within_its_limits(
        rates in prop::array::uniform4(-350_i32..=350),
        changes in prop::array::uniform4(1.0_f64..20.0),
        shares in prop::array::uniform4(2.0_f64..60.0),
        disturbances in prop::collection::vec((0_usize..80, 0_u8..3), 0..6),
    ) {
        prop_assume!(rates.iter().any(|rate| *rate != 0));
        let limits: Vec<Limits> =
            changes.iter().zip(shares).map(|(change, share)| Limits(*change, change / share)).collect();
        let table = (0..4).map(|n| axis(0, n / 2, n % 2 + 1)).collect();
        let mut fixture = moving(limited(table, &limits), &rates);
        let start: Vec<i32> = (0..4).map(|axis| fixture.axis(axis).target().unwrap()).collect();
        fixture.cia402.stop_together();
        let frame = CanFrame::classic(CanId::standard(0x7FE).unwrap(), &[0; 8]).unwrap();
        let (mut gap, mut longest_gap) = (0, 0);
        for cycle in 0..100 {
            let found = disturbances.iter().find(|(at, _)| *at == cycle);
            if found.is_some_and(|(_, kind)| *kind == 2) {
                fixture.inject(Fault::LostFrame { direction: LossDirection::Outward, cycles: 1 });
            }
            fixture.cycle_with(|cia402, bus| {
                cia402.send_targets_all(bus);
                if let Some((_, channel @ 0..2)) = found {
                    let channel = bus.channel(0, *channel).unwrap();
                    while bus.send(channel, &frame).is_ok() {}
                }
            });
            let waits = |axis| matches!(fixture.axis(axis).decision(), Decision::Wait(_));
            gap = if (0..4).any(waits) { gap + 1 } else { 0 };
            longest_gap = longest_gap.max(gap);
        }
        let state = stopped(&mut fixture);
        if state == PathStop::Done {
            assert_straight(&fixture, &start, &rates);
        } else {
            // A channel with too many frames: its axes hold, the others stop by their ramps.
            let is_held =
                |axis| matches!(fixture.axis(axis).phase(), AxisPhase::Holding(_));
            prop_assert!((0..4).any(is_held), "{}", state);
        }
        if longest_gap > 2 {
            return Ok(());
        }
        for (axis, limits) in limits.iter().enumerate() {
            assert_limits(&fixture, axis, start[axis], *limits);
        }
        fixture.check();
    }
}

#[test]
fn fault_of_an_axis_leaves_the_others_to_their_ramps() {
    let limits = [Limits(4.0, 0.25), Limits(2.0, 0.1), Limits(8.0, 2.0)];
    let mut fixture = moving(limited(axes(3), &limits), &[100, 100, 100]);
    let start: Vec<i32> = (0..3).map(|axis| fixture.axis(axis).target().unwrap()).collect();
    fixture.cia402.stop_together();
    fixture.idle(10);
    fixture.strike(1, DriveFault::Error { code: 0x2310 });
    let stop = stopped(&mut fixture);
    assert_eq!((stop, &*stop.to_string()), (PathStop::Split { axis: 1 }, "axis 1 left the path"));
    for axis in [0, 2] {
        assert_eq!(fixture.axis(axis).phase(), AxisPhase::Halted);
        assert_limits(&fixture, axis, start[axis], limits[axis]);
    }
    let travelled = |axis| {
        let course = targets(&fixture, axis, 150);
        course.last().unwrap() - course[0]
    };
    assert!(travelled(2) < travelled(0), "each by its own limits");
}

#[test]
fn lost_path_leaves_no_axis_moving() {
    let limits = [Limits(4.0, 0.25)];
    let mut fixture = moving(limited(axes(2), &limits), &[100, 50]);
    fixture.cia402.stop_together();
    fixture.idle(5);
    fixture.inject(Fault::LostFrame { direction: LossDirection::Outward, cycles: 20 });
    fixture.idle(200);
    assert_eq!(fixture.cia402.path_stop(), PathStop::Done, "at rest on the path");
    for axis in 0..2 {
        let phase = fixture.axis(axis).phase();
        assert!(matches!(phase, AxisPhase::Holding(HoldReason::WorkingCounter)), "{phase:?}");
        assert!(fixture.drive(axis, |drive| drive.velocity()).abs() < 10.0);
    }
    fixture.check();
}

#[test]
fn axis_without_targets_does_not_start_to_move_again() {
    for (cycles, continues) in [(1, true), (6, false)] {
        let mut table = limited(vec![axis(0, 0, 1)], &[Limits(4.0, 0.25)]);
        table[0].tolerances.wc_misses = 10;
        table[0].tolerances.tpdo_timeout = 20;
        let mut fixture = moving(table, &[100]);
        fixture.axis_mut(0).halt();
        fixture.idle(3);
        let before = fixture.axis(0).target().unwrap();
        fixture.inject(Fault::WorkingCounterOffset { offset: -1, cycles });
        fixture.idle(100);
        assert!(fixture.axis(0).is_at_rest());
        assert_eq!(fixture.axis(0).phase(), AxisPhase::Halted);
        let travelled = fixture.axis(0).target().unwrap() - before;
        assert_eq!(travelled > 200, continues, "{travelled} after {cycles}");
    }
}

#[test]
fn halt_after_rejected_targets_moves_nothing() {
    let mut fixture = moving(limited(vec![axis(0, 0, 1)], &[Limits(4.0, 0.25)]), &[100]);
    let at = fixture.axis(0).target().unwrap();
    fixture.axis_mut(0).set_target(at + 10_000).unwrap();
    fixture.idle(10);
    assert!(matches!(fixture.axis(0).decision(), Decision::Reject(_)));
    fixture.axis_mut(0).halt();
    fixture.idle(50);
    assert_eq!(fixture.axis(0).target(), Some(at));
}

#[test]
fn resumed_axis_splits_the_stop() {
    let limits = [Limits(4.0, 0.25)];
    let mut fixture = moving(limited(axes(2), &limits), &[100, 50]);
    fixture.cia402.stop_together();
    fixture.idle(5);
    fixture.axis_mut(0).resume();
    fixture.idle(100);
    assert_eq!(fixture.cia402.path_stop(), PathStop::Split { axis: 0 });
    assert_eq!(fixture.axis(0).phase(), AxisPhase::Running);
    assert_eq!(fixture.axis(1).phase(), AxisPhase::Halted);
}

#[test]
fn axis_at_its_bound_splits_the_stop() {
    let limits = [Limits(4.0, 0.25)];
    let mut table = limited(axes(2), &limits);
    let mut fixture = Fixture::single(table.clone()).started();
    let at = fixture.axis(0).target().unwrap();
    table[0].bounds = Some((at - 1_000, at + 8_000));
    fixture = moving(table, &[100, 100]);
    let start = fixture.axis(1).target().unwrap();
    fixture.cia402.stop_together();
    assert_eq!(stopped(&mut fixture), PathStop::Split { axis: 0 });
    assert!(fixture.history(0).iter().all(|record| record.target <= at + 8_000));
    assert_limits(&fixture, 1, start, limits[0]);
}

#[test]
fn axes_of_other_modes_are_halted() {
    let limits = [Limits(4.0, 0.25)];
    let mut table = limited(axes(2), &limits);
    table.push(axis(0, 0, 3).with_mode(OperatingMode::CyclicVelocity));
    let mut fixture = Fixture::single(table).started();
    let mut application = Application::new(&fixture.cia402, &[100, 50]);
    for n in 1..=100 {
        fixture.axis_mut(2).set_target(n * 200).unwrap();
        application.cycle(&mut fixture);
    }
    fixture.cia402.stop_together();
    assert_eq!(stopped(&mut fixture), PathStop::Done);
    for axis in 0..3 {
        assert_eq!(fixture.axis(axis).phase(), AxisPhase::Halted);
    }
    assert_eq!(fixture.axis(2).target(), Some(0));
    fixture.idle(200);
    assert!(fixture.drive(2, |drive| drive.velocity()).abs() < 10.0);
}

#[test]
fn stop_at_rest_is_done_at_once() {
    let mut fixture = Fixture::single(axes(2)).started();
    assert_eq!(fixture.cia402.path_stop(), PathStop::None);
    fixture.cia402.stop_together();
    assert_eq!(fixture.cia402.path_stop(), PathStop::Done);
    let at = fixture.axis(0).target().unwrap();
    fixture.axis_mut(0).set_target(at + 50).unwrap();
    fixture.idle(3);
    assert_eq!(fixture.axis(0).target(), Some(at), "targets are ignored");
    fixture.axis_mut(0).resume();
    fixture.axis_mut(0).set_target(at + 50).unwrap();
    fixture.idle(1);
    assert_eq!(fixture.axis(0).target(), Some(at + 50));
}
