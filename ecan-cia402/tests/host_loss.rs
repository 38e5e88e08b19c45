//! Loss of the host and of its link, in every mode: what the startup report states, and what the
//! simulated drives do.
#![allow(missing_docs)]

use std::time::Duration;

use crate::axes::{Fixture, axis, scenario, with_quirk};
use ecan_canopen::{
    CobId, DriveState, FaultReaction, HaltOption, NmtState, NodeId, NodeLossReaction,
    OperatingMode, QuickStopOption, Step, StopOption, object,
};
use ecan_cia402::{
    AxisCommand, AxisConfig, AxisPhase, Cia402, Cia402Config, DriveConfig, HostLossReaction,
    HostWatch, StopRamp,
};
use ecan_host::AdapterConfig;
use ecan_sim::{DriveFault, Fault, Scenario, TraceCause, TraceEvent, TraceRecord};
use tracing_test::traced_test;

/// Velocity before the loss, increments per second.
const SPEED: f64 = 200_000.0;
/// 0x6084 and 0x6085 of the drives, increments per second squared.
const PROFILE: f64 = 400_000.0;
const QUICK: f64 = 1_000_000.0;
/// Acceleration at the limit of the current.
const LIMIT: f64 = 4_000_000.0;
/// Deceleration by friction.
const FRICTION: f64 = 100_000.0;
/// 0x1016 of the drives.
const WATCH: Duration = Duration::from_millis(250);
/// Period of the drives' controllers.
const TICK_NS: u64 = 1_000_000;

const MODES: [OperatingMode; 5] = [
    OperatingMode::CyclicPosition,
    OperatingMode::CyclicVelocity,
    OperatingMode::CyclicTorque,
    OperatingMode::ProfileVelocity,
    OperatingMode::ProfilePosition,
];

/// Five drives on one channel.
fn drives() -> Scenario {
    let mut scenario = ecan_sim::drives(1, MODES.len() as u8);
    for node in &mut scenario.nodes {
        if let ecan_sim::NodeKind::Drive(drive) = &mut node.kind {
            drive.config.motor.max_acceleration = LIMIT as u32;
            drive.config.motor.friction = FRICTION as u32;
            drive.config.trace = 20_000;
        }
    }
    scenario
}

/// One axis in each mode.
fn table(change: impl Fn(&mut DriveConfig)) -> Vec<AxisConfig> {
    let axis_in = |(n, mode): (usize, &OperatingMode)| {
        let mut axis = axis(0, 0, n as u8 + 1).with_mode(*mode);
        let further = &mut axis.drive.further;
        further.push(Step::write(object::PROFILE_DECELERATION, 0, PROFILE as u32));
        further.push(Step::write(object::PROFILE_VELOCITY, 0, SPEED as u32));
        match mode {
            OperatingMode::CyclicPosition => {
                axis = axis.with_target_step(400);
                axis.ramp = 4;
            }
            _ => axis.step_limit = 20_000,
        }
        change(&mut axis.drive);
        axis
    };
    MODES.iter().enumerate().map(axis_in).collect()
}

fn without_heartbeat() -> Cia402Config {
    let mut config = Cia402Config::default();
    config.network.host_heartbeat = None;
    config
}

/// Axes that are started, in all modes.
fn started(change: impl Fn(&mut DriveConfig), config: Cia402Config) -> Fixture {
    let adapter = AdapterConfig::new(1).with_cycle(Duration::from_millis(2));
    Fixture::open_with(drives(), adapter, table(change), config).started()
}

/// Axes that move at [`SPEED`].
fn moving(change: impl Fn(&mut DriveConfig), config: Cia402Config) -> Fixture {
    let mut fixture = started(change, config);
    accelerate(&mut fixture);
    fixture
}

fn accelerate(fixture: &mut Fixture) {
    for cycle in 1..=2_000 {
        for (n, mode) in MODES.iter().enumerate() {
            let velocity = fixture.drive(n, |drive| drive.velocity());
            let target = match mode {
                OperatingMode::CyclicVelocity => (cycle * 20_000).min(SPEED as i32),
                // 75 thousandths balance the friction.
                OperatingMode::CyclicTorque if velocity < SPEED => 200,
                OperatingMode::CyclicTorque => 75,
                OperatingMode::ProfileVelocity => SPEED as i32,
                OperatingMode::ProfilePosition => 100_000_000,
                _ => continue,
            };
            fixture.axis_mut(n).set_target(target).unwrap();
        }
        fixture.step();
        let is_at_speed =
            |n| (fixture.drive(n, |drive| drive.velocity()) - SPEED).abs() < 0.05 * SPEED;
        if cycle > 100 && (0..MODES.len()).all(is_at_speed) {
            fixture.axis_mut(2).set_target(75).unwrap();
            fixture.steps(5);
            return;
        }
    }
    panic!("{:?}", (0..5).map(|n| fixture.drive(n, |drive| drive.velocity())).collect::<Vec<_>>());
}

/// Restarts the trace of every drive.
fn recorded(fixture: &Fixture) -> Vec<u64> {
    (0..MODES.len()).map(|n| fixture.drive(n, |drive| drive.trace().recorded())).collect()
}

fn records(fixture: &Fixture, n: usize, since: u64) -> Vec<TraceRecord> {
    fixture.drive(n, |drive| drive.trace().since(since).copied().collect())
}

/// End of the last heartbeat of the host on the bus.
fn last_heartbeat_ns(fixture: &Fixture) -> u64 {
    let frames = fixture.simulation.with_world(ecan_sim::World::take_recorded);
    let heartbeat = CobId::heartbeat(NodeId::MAX).can_id();
    let last =
        frames.iter().rev().find(|frame| frame.is_from_channel && frame.frame.id() == heartbeat);
    last.expect("a heartbeat before the loss").end_ns
}

fn deceleration(ramp: StopRamp) -> f64 {
    match ramp {
        StopRamp::Profile => PROFILE,
        StopRamp::QuickStop => QUICK,
        _ => LIMIT,
    }
}

/// The drive detected the loss by its consumer heartbeat, 0x8130.
fn is_loss(cause: TraceCause) -> bool {
    matches!(cause, TraceCause::HostLost(0x8130) | TraceCause::Fault(0x8130))
}

/// The drive did what the report had stated, `WATCH` after the last heartbeat.
fn check(fixture: &Fixture, n: usize, since: u64, heartbeat_ns: u64, reported: HostLossReaction) {
    let mode = MODES[n];
    let records = records(fixture, n, since);
    let (state, velocity) = fixture.drive(n, |drive| (drive.state(), drive.velocity()));
    let text = format!("{mode}, {reported:?}: {velocity:.0}/s in {state}");
    let due_ns = heartbeat_ns + WATCH.as_nanos() as u64;
    let is_due = |at: u64| assert!((due_ns..=due_ns + TICK_NS).contains(&at), "{text}: {at}");
    let rest_ns = |from: u64| {
        let at_rest = records.iter().skip_while(|record| record.time_ns < from).find(|record| {
            matches!(record.event, TraceEvent::Motion(motion) if motion.velocity.abs() < 656.0)
        });
        at_rest.unwrap_or_else(|| panic!("never at rest, {text}")).time_ns
    };
    match reported {
        HostLossReaction::QuickStop(ramp) | HostLossReaction::Fault(ramp) => {
            let stops = records.iter().find_map(|record| match record.event {
                TraceEvent::Stop { deceleration, cause } => {
                    Some((record.time_ns, deceleration, cause))
                }
                _ => None,
            });
            let (at, found, cause) = stops.unwrap_or_else(|| panic!("no stop, {text}"));
            is_due(at);
            assert!(is_loss(cause), "{text}: {cause:?}");
            assert_eq!(found, deceleration(ramp), "{text}");
            let longest_ns = 1.1e9 * SPEED / found + 20e6;
            assert!(rest_ns(at) - at < longest_ns as u64, "{text}");
            assert_ne!(state, DriveState::OperationEnabled, "{text}");
        }
        HostLossReaction::Coasts => {
            let release = records.iter().find_map(|record| match record.event {
                TraceEvent::Release { velocity, cause } => Some((record.time_ns, velocity, cause)),
                _ => None,
            });
            let (at, velocity, cause) = release.unwrap_or_else(|| panic!("no release, {text}"));
            assert!(is_loss(cause), "{text}: {cause:?}");
            // In CSP the motion has ended with the last target.
            if mode != OperatingMode::CyclicPosition {
                assert!(velocity > 0.9 * SPEED, "{text}: {velocity}/s");
                let coasting_ns = 1e9 * SPEED / FRICTION;
                assert!((rest_ns(at) - at) as f64 > 0.8 * coasting_ns, "{text}");
            }
            is_due(at);
        }
        HostLossReaction::HoldsPosition => {
            assert_eq!(state, DriveState::OperationEnabled, "{text}");
            assert!(rest_ns(heartbeat_ns) < heartbeat_ns + WATCH.as_nanos() as u64, "{text}");
        }
        HostLossReaction::RunsOn => {
            assert_eq!(state, DriveState::OperationEnabled, "{text}");
            assert!((velocity - SPEED).abs() < 0.1 * SPEED, "{text}");
        }
        other => panic!("{other:?}"),
    }
}

type Change = fn(&mut DriveConfig);

/// Options that are written, and the reaction of a watched drive.
const REACTIONS: [(Change, HostLossReaction); 9] = [
    (|_| {}, HostLossReaction::QuickStop(StopRamp::QuickStop)),
    (
        |drive| drive.quick_stop = Some(QuickStopOption::SlowDown),
        HostLossReaction::QuickStop(StopRamp::Profile),
    ),
    (
        |drive| drive.quick_stop = Some(QuickStopOption::QuickStopAndStay),
        HostLossReaction::QuickStop(StopRamp::QuickStop),
    ),
    (
        |drive| drive.quick_stop = Some(QuickStopOption::CurrentLimit),
        HostLossReaction::QuickStop(StopRamp::CurrentLimit),
    ),
    (|drive| drive.quick_stop = Some(QuickStopOption::Disable), HostLossReaction::Coasts),
    (|drive| drive.host_loss = Some(NodeLossReaction::DisableVoltage), HostLossReaction::Coasts),
    (
        |drive| {
            drive.host_loss = Some(NodeLossReaction::Fault);
            drive.fault_reaction = Some(FaultReaction::SlowDown);
        },
        HostLossReaction::Fault(StopRamp::Profile),
    ),
    (
        |drive| drive.host_loss = Some(NodeLossReaction::Fault),
        HostLossReaction::Fault(StopRamp::QuickStop),
    ),
    (
        |drive| {
            drive.host_loss = Some(NodeLossReaction::Fault);
            drive.fault_reaction = Some(FaultReaction::Disable);
        },
        HostLossReaction::Coasts,
    ),
];

fn undetected(mode: OperatingMode) -> HostLossReaction {
    match mode {
        OperatingMode::CyclicPosition => HostLossReaction::HoldsPosition,
        _ => HostLossReaction::RunsOn,
    }
}

/// The host stops to run its cycle, or the cable to the gateway is pulled.
#[derive(Clone, Copy, Debug)]
enum Loss {
    Host,
    Link,
}

impl Loss {
    fn strike(self, fixture: &mut Fixture) {
        match self {
            Self::Host => fixture.simulation.pass_ns(3_000_000_000),
            Self::Link => {
                fixture.inject(Fault::LinkLoss { gateway: 0, for_ms: 3_000 });
                fixture.steps(1_500);
            }
        }
    }
}

#[test]
fn reported_reaction_is_that_of_the_drive() {
    // The drives cannot distinguish the two.
    for (loss, reactions) in [(Loss::Host, &REACTIONS[..]), (Loss::Link, &REACTIONS[..2])] {
        for &(change, expected) in reactions {
            let mut fixture = moving(change, Cia402Config::default());
            let watch = HostWatch::Active(WATCH);
            let reported: Vec<_> = (0..5).map(|n| fixture.axis(n).host_loss()).collect();
            fixture.simulation.with_world(|world| world.record_bus_of(0, 0));
            fixture.steps(50);
            let since = recorded(&fixture);
            loss.strike(&mut fixture);
            let heartbeat_ns = last_heartbeat_ns(&fixture);
            for (n, reported) in reported.iter().enumerate() {
                assert_eq!((reported.reaction, reported.watch), (expected, watch), "{reported}");
                check(&fixture, n, since[n], heartbeat_ns, reported.reaction);
            }
        }
    }
}

#[test]
fn unwatched_drives_run_on_and_are_reported() {
    let unwatched: [(Change, Cia402Config, HostWatch); 3] = [
        (|_| {}, without_heartbeat(), HostWatch::NoHeartbeat),
        (|drive| drive.host_heartbeat_ms = 0, Cia402Config::default(), HostWatch::NoEntry),
        (
            |drive| drive.host_loss = Some(NodeLossReaction::None),
            Cia402Config::default(),
            HostWatch::Active(WATCH),
        ),
    ];
    for loss in [Loss::Host, Loss::Link] {
        for (change, config, watch) in &unwatched {
            let mut fixture = moving(change, config.clone());
            let risks: Vec<_> = fixture.cia402.host_loss_risks().collect();
            let listed: Vec<usize> = risks.iter().map(|risk| risk.axis).collect();
            assert_eq!(listed, [1, 2, 3, 4], "all but the axis in CSP");
            let since = recorded(&fixture);
            let now_ns = fixture.now_ns();
            loss.strike(&mut fixture);
            for n in 0..MODES.len() {
                let reported = fixture.axis(n).host_loss();
                assert_eq!(reported.reaction, undetected(MODES[n]), "{reported}");
                assert_eq!(reported.watch, *watch, "{reported}");
                check(&fixture, n, since[n], now_ns, reported.reaction);
            }
        }
    }
}

/// Without targets, motion in CSP ends at once: the motor overshoots the last target by the distance
/// that its highest acceleration needs, and returns to it.
#[test]
fn csp_motion_ends_at_the_last_target_after_the_loss() {
    let mut fixture = moving(|_| {}, Cia402Config::default());
    let since = recorded(&fixture);
    let offset =
        fixture.drive(0, |drive| drive.mechanical_position() - f64::from(drive.position()));
    Loss::Host.strike(&mut fixture);
    let last = fixture.history(0).last().map(|record| f64::from(record.target) + offset).unwrap();
    let furthest = records(&fixture, 0, since[0]).into_iter().filter_map(|record| {
        let TraceEvent::Motion(motion) = record.event else { return None };
        Some(motion.position - last)
    });
    let overshoot = furthest.fold(0.0, f64::max);
    let distance = fixture.drive(0, |drive| drive.mechanical_position()) - last;
    println!("overshoot {overshoot:.0}, distance at the end {distance:.1}");
    // The braking distance, and what the motor travels in a period of the controller.
    assert!(overshoot < 1.1 * SPEED * SPEED / (2.0 * LIMIT) + SPEED * 1e-3, "{overshoot}");
    assert!(distance.abs() < 20.0, "{distance}");
}

/// The gateway sends what it has received; nothing in it feeds the drives.
#[test]
fn gateway_sends_nothing_after_the_loss() {
    for loss in [Loss::Host, Loss::Link] {
        let mut fixture = moving(|_| {}, Cia402Config::default());
        fixture.simulation.with_world(|world| world.record_bus_of(0, 0));
        let lost_ns = fixture.now_ns();
        loss.strike(&mut fixture);
        let frames = fixture.simulation.with_world(ecan_sim::World::take_recorded);
        let last_ns =
            frames.iter().filter(|frame| frame.is_from_channel).map(|frame| frame.end_ns).max();
        let after_ns = last_ns.map_or(0, |at| at.saturating_sub(lost_ns));
        println!("{loss:?}: last frame of the gateway after {after_ns} ns");
        assert!(after_ns < 2_000_000, "{loss:?}: {after_ns} ns");
    }
}

#[test]
fn axes_stay_at_rest_after_the_link_returns() {
    let mut fixture = moving(|_| {}, Cia402Config::default());
    fixture.inject(Fault::LinkLoss { gateway: 0, for_ms: 1_000 });
    fixture.steps(500);
    let at = |fixture: &Fixture, n| fixture.drive(n, |drive| drive.mechanical_position());
    let before: Vec<f64> = (0..5).map(|n| at(&fixture, n)).collect();
    fixture.steps(3_000);
    for (n, before) in before.iter().enumerate() {
        let state = fixture.drive(n, |drive| drive.state());
        assert_ne!(state, DriveState::OperationEnabled, "axis {n} is enabled only by command");
        assert!((at(&fixture, n) - before).abs() < 1.0, "axis {n} does not move");
        assert!(!fixture.axis(n).is_running());
    }
    fixture.cia402.command_all(AxisCommand::Enable).unwrap();
    fixture.until(3_000, Cia402::all_running);
}

/// The drives left Operational, which nothing reports but the missing TPDOs.
#[test]
fn drives_without_heartbeat_are_started_after_the_link_returns() {
    let mut fixture = moving(|drive| drive.heartbeat_ms = 0, Cia402Config::default());
    fixture.inject(Fault::LinkLoss { gateway: 0, for_ms: 1_000 });
    fixture.steps(3_500);
    for n in 0..MODES.len() {
        assert_eq!(fixture.drive(n, |drive| drive.nmt_state()), NmtState::PreOperational, "{n}");
    }
    fixture.cia402.command_all(AxisCommand::Enable).unwrap();
    fixture.until(3_000, Cia402::all_running);
}

#[test]
fn option_codes_arrive_and_are_read_back() {
    let mut fixture = started(
        |drive| {
            drive.quick_stop = Some(QuickStopOption::QuickStopAndStay);
            drive.shutdown = Some(StopOption::SlowDown);
            drive.disable_operation = Some(StopOption::Disable);
            drive.halt = Some(HaltOption::QuickStop);
            drive.fault_reaction = Some(FaultReaction::SlowDown);
        },
        Cia402Config::default(),
    );
    for n in 0..MODES.len() {
        let written =
            [(0x6007, 3), (0x605A, 6), (0x605B, 1), (0x605C, 0), (0x605D, 2), (0x605E, 1)];
        for (index, value) in written {
            assert_eq!(fixture.drive(n, |drive| drive.object(index, 0)), Some(value), "{index:X}");
        }
        let read = fixture.axis(n).drive().stop_options.unwrap();
        assert_eq!(read.quick_stop, Some(QuickStopOption::QuickStopAndStay));
        assert_eq!(read.shutdown, Some(StopOption::SlowDown));
        assert_eq!(read.disable_operation, Some(StopOption::Disable));
        assert_eq!(read.halt, Some(HaltOption::QuickStop));
        assert_eq!(read.fault_reaction, Some(FaultReaction::SlowDown));
        assert_eq!(read.deceleration(StopRamp::QuickStop), Some(QUICK as u32));
        assert_eq!(read.deceleration(StopRamp::Profile), Some(PROFILE as u32));
    }
    // What was read belongs to the configuration.
    fixture.axis_mut(0).configure().unwrap();
    assert_eq!(fixture.axis(0).drive().stop_options, None);
    assert_eq!(fixture.axis(0).host_loss().reaction, HostLossReaction::Unknown);
    fixture.until(1_000, |cia402| cia402.axis(0).unwrap().phase() == AxisPhase::Standby);
    assert!(fixture.axis(0).drive().stop_options.is_some());
}

/// A released drive would run on: it no longer watches the host.
#[test]
fn released_drives_are_reported_as_unwatched() {
    let mut fixture = started(|_| {}, Cia402Config::default());
    assert_eq!(fixture.cia402.host_loss_risks().count(), 0);
    fixture.cia402.blocking(&mut fixture.port, crate::axes::START).shut_down().unwrap();
    for (n, mode) in MODES.iter().enumerate() {
        assert_eq!(fixture.drive(n, |drive| drive.object(0x1016, 1)), Some(0), "{mode}");
        let reported = fixture.axis(n).host_loss();
        assert_eq!((reported.watch, reported.reaction), (HostWatch::NoEntry, undetected(*mode)));
    }
}

#[test]
fn unwritten_options_are_read_back() {
    let fixture = Fixture::single(vec![axis(0, 0, 1)]).started();
    let read = fixture.axis(0).drive().stop_options.unwrap();
    assert_eq!(read.quick_stop, Some(QuickStopOption::QuickStop));
    assert_eq!(read.shutdown, Some(StopOption::Disable));
    assert_eq!(read.disable_operation, Some(StopOption::SlowDown));
    assert_eq!(read.halt, Some(HaltOption::SlowDown));
    assert_eq!(read.fault_reaction, Some(FaultReaction::QuickStop));
}

#[test]
fn drive_without_the_objects_starts_and_is_reported() {
    let velocity = || vec![axis(0, 0, 1).with_mode(OperatingMode::CyclicVelocity)];
    let cases = [
        (0x1016, HostLossReaction::RunsOn, "0x1016 has no entry for the host"),
        (0x6007, HostLossReaction::Unknown, "unknown reaction"),
        (0x605A, HostLossReaction::Unknown, "unknown reaction"),
    ];
    for (missing, reaction, part) in cases {
        let scenario = with_quirk(1, 1, |quirks| quirks.missing = vec![missing]);
        let fixture = Fixture::with(scenario, velocity()).started();
        let risk = fixture.cia402.host_loss_risks().next().unwrap();
        assert_eq!(risk.reaction, reaction, "{risk}");
        assert!(risk.to_string().contains(part), "{risk}");
    }
    let fixture = Fixture::with(scenario(1, |_| {}), velocity()).started();
    assert_eq!(fixture.cia402.host_loss_risks().count(), 0);
}

#[test]
#[traced_test]
fn risks_are_logged_once_at_the_end_of_the_configuration() {
    let scenario = with_quirk(1, 1, |quirks| quirks.missing = vec![0x1016]);
    let mode = OperatingMode::CyclicVelocity;
    let table = vec![axis(0, 0, 1).with_mode(mode), axis(0, 0, 2).with_mode(mode)];
    let mut fixture = Fixture::with(scenario, table).started();
    fixture.idle(200);
    logs_assert(|lines: &[&str]| {
        let lines = lines.iter().filter(|line| line.contains("if the host is lost"));
        let (count, has_first) = lines.fold((0, false), |(count, has_first), line| {
            (count + 1, has_first || line.contains("WARN") && line.contains("axis 0, node 1"))
        });
        if (count, has_first) == (1, true) { Ok(()) } else { Err(format!("{count} lines")) }
    });
}

#[test]
fn drive_in_bus_off_stops_and_can_be_enabled_again() {
    let mut fixture = moving(|_| {}, Cia402Config::default());
    let since = recorded(&fixture);
    for n in 0..MODES.len() {
        fixture.strike(n, DriveFault::BusOff { for_ms: 200 });
    }
    fixture.steps(200);
    for (n, mode) in MODES.iter().enumerate() {
        let stop =
            records(&fixture, n, since[n]).into_iter().find_map(|record| match record.event {
                TraceEvent::Stop { deceleration, cause } => Some((deceleration, cause)),
                _ => None,
            });
        assert_eq!(stop, Some((QUICK, TraceCause::HostLost(0x8140))), "{mode}");
        assert!(fixture.drive(n, |drive| drive.velocity()).abs() < 656.0, "{mode}");
        assert!(!fixture.axis(n).is_running(), "{mode}");
    }
    fixture.cia402.command_all(AxisCommand::Enable).unwrap();
    fixture.until(3_000, Cia402::all_running);
}
