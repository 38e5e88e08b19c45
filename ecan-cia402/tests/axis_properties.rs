//! Random sequences of faults and commands, with targets at their very limits: what the drives got
//! is judged by the drives.
#![allow(missing_docs)]

use crate::axes::{Fixture, axes, scenario};
use ecan_canopen::{DriveState, OperatingMode};
use ecan_cia402::{
    AxisCommand, AxisConfig, AxisPhase, AxisRef, FeedForward, FeedForwardLimits, InputObject,
    OutputObject, StopKind, Target,
};
use ecan_sim::{DriveFault, Fault, GatewayFault, LossDirection};
use proptest::prelude::*;

const AXES: usize = 3;
const STEP: i32 = 150;

#[derive(Debug, Clone)]
enum Event {
    LostFrames(LossDirection, u32),
    BusOff,
    ErrorFrames(u32),
    Silent(usize, u32),
    DriveError(usize),
    DrivePower(usize, u32),
    Blocked(usize, u32),
    GatewayPower(u32),
    LinkLoss(u32),
    Torn,
    Stall(u32),
    HostPause(u64),
    Enable(usize),
    Disable(usize),
    QuickStop(usize),
    Halt(usize),
    Resume(usize),
    Reset(usize),
    Turn(usize),
    FarTarget(usize, i32),
    /// Cycles without `process_rx`, with or without targets.
    Skip(usize, bool),
}

fn event() -> impl Strategy<Value = Event> {
    let n = 0..AXES;
    prop_oneof![
        3 => (any::<bool>(), 1..8_u32).prop_map(|(out, cycles)| {
            Event::LostFrames(if out { LossDirection::Outward } else { LossDirection::Return }, cycles)
        }),
        2 => Just(Event::BusOff),
        1 => (1..20_u32).prop_map(Event::ErrorFrames),
        1 => (n.clone(), 1..300_u32).prop_map(|(n, ms)| Event::Silent(n, ms)),
        1 => n.clone().prop_map(Event::DriveError),
        1 => (n.clone(), 1..300_u32).prop_map(|(n, ms)| Event::DrivePower(n, ms)),
        1 => (n.clone(), 1..200_u32).prop_map(|(n, ms)| Event::Blocked(n, ms)),
        1 => (10..300_u32).prop_map(Event::GatewayPower),
        1 => (1..50_u32).prop_map(Event::LinkLoss),
        1 => Just(Event::Torn),
        1 => (1..12_u32).prop_map(Event::Stall),
        1 => (1..300_u64).prop_map(Event::HostPause),
        2 => n.clone().prop_map(Event::Enable),
        1 => n.clone().prop_map(Event::Disable),
        1 => n.clone().prop_map(Event::QuickStop),
        1 => n.clone().prop_map(Event::Halt),
        1 => n.clone().prop_map(Event::Resume),
        2 => n.clone().prop_map(Event::Reset),
        2 => n.clone().prop_map(Event::Turn),
        1 => (n, any::<i32>()).prop_map(|(n, to)| Event::FarTarget(n, to)),
        3 => (1..12_usize, any::<bool>()).prop_map(|(cycles, sends)| Event::Skip(cycles, sends)),
    ]
}

fn strike(fixture: &mut Fixture, event: &Event) {
    let gateway = |fault| Fault::Gateway { gateway: 0, fault };
    match *event {
        Event::LostFrames(way, cycles) => {
            fixture.inject(Fault::LostFrame { direction: way, cycles })
        }
        Event::BusOff => fixture.inject(Fault::BusOff { gateway: 0, channel: 0 }),
        Event::ErrorFrames(frames) => {
            fixture.inject(Fault::ErrorFrames { gateway: 0, channel: 0, frames });
        }
        Event::Silent(n, for_ms) => {
            let node = fixture.axis(n).config().address.node;
            fixture.inject(Fault::NodeSilent { node: format!("drive 0.0/{node}"), for_ms });
        }
        Event::DriveError(n) => {
            let axis = fixture.axis(n).config().node_axis;
            fixture.strike(n, DriveFault::AxisError { axis, code: 0x2310 });
        }
        Event::DrivePower(n, off_ms) => fixture.strike(n, DriveFault::PowerCycle { off_ms }),
        Event::Blocked(n, for_ms) => fixture.strike(n, DriveFault::Blocked { for_ms }),
        Event::GatewayPower(off_ms) => fixture.inject(Fault::PowerCycle { gateway: 0, off_ms }),
        Event::LinkLoss(for_ms) => fixture.inject(Fault::LinkLoss { gateway: 0, for_ms }),
        Event::Torn => fixture.inject(gateway(GatewayFault::TornTxPdo { images: 2 })),
        Event::Stall(ms) => fixture.inject(gateway(GatewayFault::ServiceStall { ms })),
        Event::HostPause(ms) => fixture.simulation.pass_ns(ms * 1_000_000),
        Event::Skip(cycles, sends) => fixture.skip(cycles, sends),
        _ => {}
    }
    // A command that is rejected is one more thing that can happen.
    let _ = match *event {
        Event::Enable(n) => fixture.axis_mut(n).enable(),
        Event::Disable(n) => fixture.axis_mut(n).command(AxisCommand::Stop(StopKind::Disable)),
        Event::QuickStop(n) => fixture.axis_mut(n).command(AxisCommand::Stop(StopKind::QuickStop)),
        Event::Halt(n) => fixture.axis_mut(n).command(AxisCommand::Halt),
        Event::Resume(n) => fixture.axis_mut(n).command(AxisCommand::Resume),
        Event::Reset(n) => fixture.axis_mut(n).reset_fault(),
        Event::Turn(n) => fixture.axis_mut(n).command(AxisCommand::TargetStep(-STEP)),
        Event::FarTarget(n, to) => fixture.axis_mut(n).set_target(to),
        _ => Ok(()),
    };
}

/// A patient operator: every axis that holds is activated again. A command that is rejected
/// is given again later.
fn operate(fixture: &mut Fixture) {
    for n in 0..AXES {
        let _ = match fixture.axis(n).phase() {
            AxisPhase::NotConfigured | AxisPhase::SetupFailed => fixture.axis_mut(n).configure(),
            AxisPhase::Halted => fixture.axis_mut(n).command(AxisCommand::Resume),
            AxisPhase::Fault => fixture.axis_mut(n).reset_fault(),
            AxisPhase::Standby | AxisPhase::Holding(_) | AxisPhase::Stopped(_) => {
                fixture.axis_mut(n).enable()
            }
            _ => Ok(()),
        };
    }
}

/// Targets at the limit: a step is the limit.
fn table() -> Vec<AxisConfig> {
    let at_the_limit = |mut axis: AxisConfig| {
        axis.step_limit = STEP as u32;
        axis.target_step = STEP;
        axis.following_window = 3_000;
        axis.ramp = 50;
        axis.drive.following_error = Some((3_000, 20));
        axis
    };
    axes(AXES).into_iter().map(at_the_limit).collect()
}

/// The same with a feed-forward of the first axis, the second one in IP, and further inputs.
fn extended_table() -> Vec<AxisConfig> {
    let mut table = table();
    table[0].pdos.outputs = vec![OutputObject::VelocityOffset, OutputObject::TorqueOffset];
    table[0].feed_forward = LIMITS;
    table[1].mode = OperatingMode::InterpolatedPosition;
    table[1].drive.interpolation_buffer = Some(2);
    table[2].pdos.inputs = vec![InputObject::Velocity, InputObject::FollowingError];
    table
}

/// The first two axes are those of one node.
fn table_of_shared_node() -> Vec<AxisConfig> {
    let mut table = table();
    table[1] = table[0].clone().with_node_axis(1, 2);
    table[2] = AxisConfig { address: axes(2)[1].address, ..table[2].clone() };
    table
}

const LIMITS: FeedForwardLimits =
    FeedForwardLimits { velocity: 75_000, velocity_change: 9_000, torque: 40, torque_change: 7 };

/// A cycle in which the application moves every axis by its step, with any feed-forward.
fn travel(fixture: &mut Fixture, forwards: &[FeedForward], nth: usize) {
    fixture.cycle_with(|cia402, cycle| {
        for n in 0..AXES {
            let forward = forwards[(nth + n) % forwards.len()];
            let step = cia402.axis(n).unwrap().config().target_step;
            if let Some(target) = cia402.axis(n).unwrap().target() {
                let _ = cia402.axis_mut(n).unwrap().set_target(
                    Target::from(target.saturating_add(step)).with_feed_forward(forward),
                );
            }
        }
        cia402.send_targets_all(cycle);
    });
}

fn forward() -> impl Strategy<Value = FeedForward> {
    let velocity = prop_oneof![3 => -90_000..90_000_i32, 1 => any::<i32>()];
    (velocity, any::<i16>()).prop_map(|(velocity, torque)| FeedForward { velocity, torque })
}

/// Lets the events happen, then brings all axes back, and checks what the drives received.
fn run(
    mut fixture: Fixture,
    events: &[(Event, usize)],
    mut step: impl FnMut(&mut Fixture, usize),
) -> Result<Fixture, TestCaseError> {
    for (event, cycles) in events {
        strike(&mut fixture, event);
        for cycle in 0..*cycles {
            step(&mut fixture, cycle);
            if cycle % 40 == 39 {
                operate(&mut fixture);
            }
        }
    }
    // And back to work, however bad it was. What has struck may show late.
    let mut sound = 0;
    for cycle in 0..20_000 {
        sound = if fixture.cia402.all_running() { sound + 1 } else { 0 };
        if sound > 400 {
            break;
        }
        step(&mut fixture, cycle);
        if cycle % 40 == 39 {
            operate(&mut fixture);
        }
    }
    prop_assert!(
        sound > 400,
        "gateway {}, {:#?}",
        fixture.session(),
        fixture
            .cia402
            .axes()
            .map(AxisRef::progress)
            .map(|axis| axis.to_string())
            .collect::<Vec<_>>()
    );
    for n in 0..AXES {
        let state = fixture.drive_axis(n, |drive| drive.state());
        prop_assert_eq!(state, DriveState::OperationEnabled);
    }
    fixture.check();
    Ok(fixture)
}

proptest! {
    #![proptest_config(ProptestConfig {
        cases: crate::axes::cases(64),
        failure_persistence: None,
        max_shrink_iters: 200,
        ..ProptestConfig::default()
    })]

    #[test]
    fn no_axis_ever_jumps(events in prop::collection::vec((event(), 1..120_usize), 1..14)) {
        run(Fixture::single(table()).started(), &events, |fixture, _| fixture.step())?;
    }

    #[test]
    fn no_axis_of_a_shared_node_jumps(
        events in prop::collection::vec((event(), 1..120_usize), 1..14),
    ) {
        let fixture = Fixture::with(scenario(1, |drive| drive.axes = 2), table_of_shared_node());
        run(fixture.started(), &events, |fixture, _| fixture.step())?;
    }

    #[test]
    fn no_axis_jumps_with_feed_forward_or_interpolation(
        events in prop::collection::vec((event(), 1..120_usize), 1..14),
        forwards in prop::collection::vec(forward(), 1..50),
    ) {
        let fixture = Fixture::single(extended_table()).started();
        let fixture = run(fixture, &events, |fixture, nth| travel(fixture, &forwards, nth))?;
        for n in 0..AXES {
            let sums = fixture.drive(n, |drive| *drive.targets().sums());
            let (velocity, torque) = sums.largest_offsets;
            let (velocity_change, torque_change) = sums.largest_offset_changes;
            let limits = fixture.axis(n).config().feed_forward;
            prop_assert!(velocity <= limits.velocity && torque <= limits.torque.into(), "{:?}", sums);
            // A frame that is lost on the path makes two changes one.
            prop_assert!(velocity_change <= 2 * limits.velocity_change, "{:?}", sums);
            prop_assert!(torque_change <= 2 * u32::from(limits.torque_change), "{:?}", sums);
            prop_assert_eq!(sums.firsts_with_offsets, 0);
        }
    }
}

/// The image with the last target is lost. The feed-forward of the target before moves the axis on, and
/// its motor is blocked there, more than a step from the target that the drive holds.
#[test]
fn axis_that_a_feed_forward_moved_on_gets_no_large_step() {
    let events = [
        (Event::ErrorFrames(1), 11),
        (Event::LostFrames(LossDirection::Outward, 4), 2),
        (Event::Blocked(0, 88), 40),
    ];
    let forwards = [(433, 0), (17_468, 0), (26_351, 7), (25, 19_797), (70_545, -15_373)]
        .map(|(velocity, torque)| FeedForward { velocity, torque });
    let fixture = Fixture::single(extended_table()).started();
    run(fixture, &events, |fixture, nth| travel(fixture, &forwards, nth)).unwrap();
}
