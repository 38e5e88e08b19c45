//! The cycle with 40 axes allocates nothing: while they move, while some are silent, hold, are
//! enabled again, are homed.
#![allow(missing_docs)]

use std::time::Duration;

mod axes;

use axes::{Fixture, axes};
use ecan_canopen::{Probe, ProbeSource, ProbeTrigger};
use ecan_cia402::{
    AxesSnapshot, AxisCommand, AxisConfig, FeedForward, FeedForwardLimits, HomingConfig,
    InputObject, Output, OutputObject, PathStop, StopKind, Target,
};
use ecan_host::AdapterConfig;
use ecan_sim::{Fault, LossDirection};
use ecan_test_support::{CountingAllocator, allocations};

#[global_allocator]
static ALLOCATOR: CountingAllocator = CountingAllocator;

/// Cycles of the axes, with what is allocated between begin and end.
fn cycles(fixture: &mut Fixture, count: usize) -> u64 {
    (0..count)
        .map(|_| {
            fixture.port.wait_next_cycle();
            let before = allocations();
            let mut cycle = fixture.port.begin_cycle();
            fixture.cia402.process_rx(&mut cycle);
            fixture.cia402.send_target_step(&mut cycle);
            drop(cycle);
            allocations() - before
        })
        .sum()
}

const FORWARD: FeedForward = FeedForward { velocity: 5_000, torque: 7 };

/// Cycles in which the application moves the first axis with a feed-forward, and arms its touch probe.
fn fed_forward_cycles(fixture: &mut Fixture, count: usize) -> u64 {
    (0..count)
        .map(|_| {
            fixture.port.wait_next_cycle();
            let before = allocations();
            let mut cycle = fixture.port.begin_cycle();
            let cia402 = &mut fixture.cia402;
            cia402.process_rx(&mut cycle);
            let target = cia402.axis(0).unwrap().target().unwrap() + 10;
            cia402
                .axis_mut(0)
                .unwrap()
                .set_target(Target::from(target).with_feed_forward(FORWARD))
                .unwrap();
            let trigger = ProbeTrigger::first_positive(ProbeSource::IndexPulse);
            cia402
                .axis_mut(0)
                .unwrap()
                .set_output(Output::Probe(Probe::One, Some(trigger)))
                .unwrap();
            cia402.send_targets_all(&mut cycle);
            drop(cycle);
            allocations() - before
        })
        .sum()
}

#[test]
fn forty_axes_allocate_nothing() {
    let jerk_limited = |axis: AxisConfig| {
        let mut axis = axis.with_target_step(50);
        axis.limits.jerk = Some(1e6);
        axis
    };
    let mut table: Vec<AxisConfig> = axes(40).into_iter().map(jerk_limited).collect();
    let extended = &mut table[0];
    extended.pdos.outputs =
        vec![OutputObject::VelocityOffset, OutputObject::TorqueOffset, OutputObject::ProbeFunction];
    extended.pdos.inputs =
        vec![InputObject::Velocity, InputObject::ProbeStatus, InputObject::Probe1Positive];
    extended.feed_forward =
        FeedForwardLimits { velocity: 10_000, velocity_change: 100, torque: 10, torque_change: 1 };
    let adapter = AdapterConfig::new(3).with_multiplier(6).with_cycle(Duration::from_millis(2));
    let mut fixture = Fixture::open(ecan_sim::drives(3, 4), adapter, table).started();
    // Every cycle publishes a snapshot.
    let observer = fixture.port.adapter().observer();
    let mut snapshot = observer.snapshot();
    // The simulated world grows its queues to their working size first.
    cycles(&mut fixture, 500);
    assert_eq!(cycles(&mut fixture, 500), 0, "in motion");
    assert_eq!(fed_forward_cycles(&mut fixture, 500), 0, "with feed-forward");
    assert_eq!(fixture.axis(0).status().feed_forward, FORWARD);
    fixture.inject(Fault::LostFrame { direction: LossDirection::Outward, cycles: 6 });
    fixture.inject(Fault::NodeSilent { node: "drive 1.2/3".to_owned(), for_ms: 500 });
    assert_eq!(cycles(&mut fixture, 500), 0, "with faults");
    assert!(!fixture.axis(0).is_running());
    fixture.cia402.command_all(AxisCommand::Enable).unwrap();
    assert_eq!(cycles(&mut fixture, 500), 0, "during activation");
    assert!(fixture.cia402.all_running());
    let before = allocations();
    fixture.axis_mut(7).home(HomingConfig::new(37)).unwrap();
    fixture.axis_mut(8).stop(StopKind::QuickStop);
    fixture.axis_mut(9).halt();
    assert_eq!(allocations() - before, 0, "commands");
    assert_eq!(cycles(&mut fixture, 2_000), 0, "while one is homed");
    assert!(fixture.axis(7).is_running() && !fixture.axis(8).is_running());
    fixture.axis_mut(8).enable().unwrap();
    fixture.axis_mut(9).resume();
    cycles(&mut fixture, 500);
    let before = allocations();
    fixture.cia402.stop_together();
    assert_eq!(allocations() - before, 0, "stop of all axes");
    assert_eq!(fixture.cia402.path_stop(), PathStop::Decelerating);
    assert_eq!(cycles(&mut fixture, 100), 0, "while all axes stop");
    assert_eq!(fixture.cia402.path_stop(), PathStop::Done);
    snapshot.update().unwrap();
    assert_eq!(AxesSnapshot::of(&snapshot).map(|axes| axes.axis_count()), Some(40));
    let before = allocations();
    observer.quick_stop(3).unwrap();
    observer.quick_stop_all();
    assert_eq!(allocations() - before, 0, "commands of an observer");
    assert_eq!(cycles(&mut fixture, 10), 0, "while they are executed");
    let before = allocations();
    snapshot.update().unwrap();
    assert_eq!(allocations() - before, 0, "a read");
    fixture.check();
}
