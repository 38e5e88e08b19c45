//! Limits as the drive executes them: judged by the drive's own record of its targets, and by the
//! velocity of its motor in each controller period.
#![allow(missing_docs)]

use std::time::Duration;

use crate::axes::{Fixture, axis, scenario};
use crate::support::limits::{
    MS, MotorWatch, Random, STEP, adapter, at_limit, config, fixture, largest_step,
};
use ecan_canopen::{DriveState, OperatingMode, object};
use ecan_cia402::{AxisCommand, AxisPhase, Cia402, Cia402Config, Decision, StopKind, WaitReason};
use ecan_host::DcSync;
use ecan_mcan_port::{Cycle, SendOptions};
use ecan_protocol::can::{CanFrame, CanId};
use ecan_sim::{AttachedNode, Fault, GatewayFault, LossDirection, Node, NodeOutput, TraceEvent};

// Cycles without calls

#[test]
fn cycle_without_process_rx_sends_no_target() {
    let mut fixture = fixture(2_000, at_limit(1), config(1, 1));
    fixture.start();
    fixture.steps(100);
    let sent = fixture.axis(0).statistics().targets_sent;
    for _ in 0..5 {
        let mut cycle = fixture.port.next_cycle();
        let summary = fixture.cia402.send_target_step(&mut cycle);
        assert_eq!((summary.targets, summary.waiting), (0, 1));
        assert_eq!(
            fixture.cia402.axis(0).unwrap().decision(),
            Decision::Wait(WaitReason::NotReceived)
        );
    }
    assert_eq!(fixture.axis(0).statistics().targets_sent, sent);
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
                let _ = fixture.cia402.command_all(AxisCommand::Enable);
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

/// A frame of 8 bytes at 1 Mbit/s.
const FRAME_NS: u64 = 130_000;

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
            let _ = match fixture.axis(axis).phase() {
                AxisPhase::Fault => fixture.axis_mut(axis).reset_fault(),
                AxisPhase::Standby | AxisPhase::Holding(_) => fixture.axis_mut(axis).enable(),
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
        fixture.cia402.command_all(AxisCommand::Stop(StopKind::QuickStop)).unwrap();
        fixture.idle(60);
        drop(node);
        let stopped = |drive: &ecan_sim::Drive| {
            let mut records = drive.trace().iter().filter(|record| record.time_ns >= free_ns);
            let stop = records.find(|record| matches!(record.event, TraceEvent::Stop { .. }));
            stop.map(|record| record.time_ns - free_ns)
        };
        let delay_ns = fixture.drive(0, stopped).expect("the drive stops");
        // Of three images and the command, RPDOs and SYNC; two answers of each drive.
        let rpdos = 2;
        let most_ns = (6 * rpdos + 4) * FRAME_NS;
        assert!(delay_ns < most_ns, "{cycle_us} us: {delay_ns} ns after the bus is free");
    }
}

/// Each target is a step limit above the last one sent.
fn accelerate(fixture: &mut Fixture, cycles: usize) {
    for _ in 0..cycles {
        if let Some(target) = fixture.axis(0).target() {
            fixture.axis_mut(0).set_target(target + STEP as i32).unwrap();
        }
        fixture.cycle_with(|cia402, cycle| cia402.send_targets_all(cycle));
    }
}

/// Phases of targets and SYNC: the SYNC after its targets, before them, and one of both at once.
const PHASES: [(Option<u32>, Option<u32>); 4] = [
    (Some(200_000), Some(300_000)),
    (Some(300_000), Some(200_000)),
    (Some(200_000), None),
    (None, Some(300_000)),
];

/// Nothing is released late. A late frame is dropped, and the next target makes its step, too: the
/// image in the sync manager of the stalled gateway is the only one.
#[test]
fn scheduled_targets_are_not_released_late() {
    for (target_ns, sync_ns) in PHASES {
        for ms in [2, 6, 20] {
            let mut fixture = scheduled(2_000, (target_ns, sync_ns), config(1, 1));
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

fn scheduled(
    cycle_us: u64,
    (target_ns, sync_ns): (Option<u32>, Option<u32>),
    settings: Cia402Config,
) -> Fixture {
    let mut adapter = adapter(cycle_us);
    adapter.dc = Some(DcSync::new(Duration::from_micros(cycle_us), Duration::from_micros(700)));
    let traced = scenario(1, |drive| drive.trace = 100_000);
    let mut fixture = Fixture::open_with(traced, adapter, at_limit(2), settings);
    fixture.cia402.set_scheduled_tx(&fixture.port, target_ns, sync_ns).unwrap();
    fixture.start();
    fixture.steps(200);
    fixture
}

/// The host loses time inside a cycle: the image comes too late for the phase, and its SYNC or targets are withdrawn.
/// The next target must not make their step, too.
#[test]
fn time_lost_inside_a_cycle_adds_no_scheduled_target() {
    for phases in PHASES {
        for lost_us in [400, 1_300, 3_000, 9_700, 100_000, 2_000_000] {
            let mut fixture = scheduled(2_000, phases, config(1, 1));
            for _ in 0..3 {
                let simulation = fixture.simulation.clone();
                fixture.cycle_with(|cia402, cycle| {
                    cia402.send_target_step(cycle);
                    simulation.pass_ns(lost_us * 1_000);
                });
                fixture.steps(20);
                let _ = fixture.cia402.command_all(AxisCommand::Recover);
                fixture.steps(400);
            }
            let case = format!("{phases:?} {lost_us} us");
            assert!(largest_step(&fixture, 0) <= STEP, "{case}: {}", largest_step(&fixture, 0));
            // After a longer time the gateway has left OP, and returns after seconds.
            assert!(fixture.cia402.all_running() || lost_us >= 100_000, "{case}");
        }
    }
}

/// A scheduled target takes effect with the SYNC after that of its own image. Late ones must not bring two targets into
/// one period.
#[test]
fn late_sync_keeps_scheduled_targets_a_period_apart() {
    for sync_ns in [None, Some(50_000)] {
        keep_a_period_apart(scheduled(2_000, (Some(116_000), sync_ns), config(4, 3)));
    }
}

fn keep_a_period_apart(mut fixture: Fixture) {
    let watch = MotorWatch::new(&fixture, 0);
    let mut random = Random(7);
    for _ in 0..1_500 {
        let mut cycle = fixture.port.next_cycle();
        fixture.cia402.process_rx(&mut cycle);
        if random.below(5) > 0 {
            fixture.cia402.send_target_step(&mut cycle);
        }
    }
    let period_ns = fixture.cia402.target_period().as_nanos() as u64;
    assert_eq!(watch.most_targets(&fixture, period_ns - MS), 1);
    let fastest = watch.velocities(&fixture).into_iter().fold(0.0, f64::max);
    assert!(fastest < 1.3 * f64::from(STEP) * 1e9 / period_ns as f64, "{fastest}");
    assert!(largest_step(&fixture, 0) <= STEP);
}

/// The motor still creeps to the last target when the axis is enabled again, in each phase of the SYNC period.
#[test]
fn first_target_after_a_hold_is_the_position_when_it_takes_effect() {
    for (every_cycles, phases) in [
        (1, (None, None)),
        (1, (Some(200_000), None)),
        (4, (Some(200_000), None)),
        (1, (Some(300_000), Some(200_000))),
        (4, (Some(300_000), Some(200_000))),
    ] {
        for phase in 0..12 {
            let mut fixture = scheduled(1_000, phases, config(1, every_cycles));
            fixture.inject(Fault::LostFrame { direction: LossDirection::Return, cycles: 5 });
            fixture.until(40, |cia402| {
                matches!(cia402.axis(0).unwrap().phase(), AxisPhase::Holding(_))
            });
            fixture.steps(phase);
            fixture.axis_mut(0).enable().unwrap();
            fixture.until(500, |cia402| cia402.axis(0).unwrap().is_running());
            // The first target was sent in the last cycle; those before the hold have left the gateway.
            let from_ns = fixture.now_ns();
            fixture.steps(20);
            let history = fixture.history(0);
            let first = history.iter().find(|record| record.time_ns > from_ns).unwrap();
            let most = 2 * fixture.axis(0).config().standstill;
            let case = format!("SYNC every {every_cycles} cycles, {phases:?}, cycle {phase}");
            assert!(first.offset() <= most, "{case}: {}", first.offset());
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
            assert_eq!(fixture.axis(axis).statistics().waits, 0, "axis {axis}, SDO {with_sdo}");
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
        (disturbed.fastest, fixture.axis(0).drive_state())
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
    fixture.axis_mut(0).halt();
    fixture.idle(50);
    let after = fixture.drive(0, ecan_sim::Drive::mechanical_position);
    assert!(fixture.axis(0).is_running() || fixture.axis(0).is_at_rest());
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
