//! Stops in every state and mode, judged by velocity and state of the simulated drive.
//!
//! The motor turns at 200,000 increments/s. A quick stop (0x6085) takes 200 ms, a slow down
//! (0x6084) 1 s, coasting by friction 2 s, so the trace of the velocity shows which one it was.
#![allow(missing_docs)]

mod axes;

use std::fmt;
use std::time::Duration;

use axes::{Fixture, START, axis, scenario};
use ecan_canopen::{CobId, DriveState, FaultReaction, NodeId, OperatingMode, Step, object};
use ecan_cia402::{
    AxisConfig, AxisPhase, Cia402, Cia402Config, CommandError, HomingConfig, StopCause, Takeover,
};
use ecan_protocol::object::AbortCode;
use ecan_sim::{
    DriveConfig, DriveFault, Fault, LossDirection, Scenario, SdoDirection, SdoEffect, SdoRule,
};

/// Velocity before a stop, increments per second.
const SPEED: f64 = 200_000.0;
/// Quick stop deceleration 0x6085 of the drives, increments per second squared.
const QUICK: f64 = 1_000_000.0;
/// Profile deceleration 0x6084.
const PROFILE: f64 = 200_000.0;
/// Velocity at which the drive regards its motor as settled.
const REST: f64 = 656.0;
/// Longest time from the call to the deceleration if frames can leave.
const REACTION_MS: f64 = 20.0;
/// Longest time from the return of a drive, channel or gateway to the deceleration.
const RETURN_MS: f64 = 100.0;
/// Time for which a drive is watched that does not stop.
const WATCH_MS: f64 = 5_000.0;

const RATE_AND_PROFILE_MODES: [OperatingMode; 4] = [
    OperatingMode::CyclicVelocity,
    OperatingMode::CyclicTorque,
    OperatingMode::ProfileVelocity,
    OperatingMode::ProfilePosition,
];

/// Motors with little friction, whose 0x6085 is [`QUICK`] and 0x6084 [`PROFILE`].
fn drives(change: impl Fn(&mut DriveConfig)) -> Scenario {
    scenario(1, |drive| {
        drive.motor.max_acceleration = 4_000_000;
        drive.motor.friction = 100_000;
        change(drive);
    })
}

fn axis_in(mode: OperatingMode) -> AxisConfig {
    let mut axis = axis(0, 0, 1).with_mode(mode);
    match mode {
        OperatingMode::CyclicPosition => {
            axis = axis.with_target_step(400);
            axis.ramp = 4;
        }
        OperatingMode::ProfilePosition => {
            axis.drive.further.push(Step::write(object::PROFILE_VELOCITY, 0, SPEED as u32));
        }
        _ => axis.step_limit = 20_000,
    }
    axis
}

/// Whether drives watch the heartbeat of the host.
#[derive(Clone, Copy, Debug, PartialEq)]
enum HostHeartbeat {
    On,
    Off,
}

fn table(mode: OperatingMode, heartbeat: HostHeartbeat) -> Vec<AxisConfig> {
    let mut axis = axis_in(mode);
    if heartbeat == HostHeartbeat::Off {
        axis.drive.host_heartbeat_ms = 0;
    }
    vec![axis]
}

fn config(heartbeat: HostHeartbeat) -> Cia402Config {
    let mut config = Cia402Config::default();
    if heartbeat == HostHeartbeat::Off {
        config.network.host_heartbeat = None;
    }
    config
}

fn open(scenario: Scenario, mode: OperatingMode, heartbeat: HostHeartbeat) -> Fixture {
    let adapter = ecan_host::AdapterConfig::new(1).with_cycle(Duration::from_millis(2));
    Fixture::open_with(scenario, adapter, table(mode, heartbeat), config(heartbeat))
}

/// An axis that moves at [`SPEED`].
fn at_speed_with(fixture: Fixture, mode: OperatingMode) -> Fixture {
    let mut fixture = fixture.started();
    accelerate(&mut fixture, mode);
    fixture
}

fn accelerate(fixture: &mut Fixture, mode: OperatingMode) {
    let far = fixture.cia402.actual(0).unwrap() + 100_000_000;
    for cycle in 1..=2_000 {
        let target = match mode {
            OperatingMode::CyclicVelocity => Some((cycle * 20_000).min(SPEED as i32)),
            OperatingMode::CyclicTorque => Some(300),
            OperatingMode::ProfileVelocity => Some(SPEED as i32),
            OperatingMode::ProfilePosition => Some(far),
            _ => None,
        };
        if let Some(target) = target {
            fixture.cia402.set_target(0, target).unwrap();
        }
        fixture.step();
        if velocity(fixture) > 0.98 * SPEED {
            break;
        }
    }
    if mode == OperatingMode::CyclicTorque {
        // Balances friction: 100,000 of 4,000,000 increments/s² at 3000 thousandths.
        fixture.cia402.set_target(0, 75).unwrap();
    }
    fixture.steps(20);
    let velocity = velocity(fixture);
    assert!((velocity - SPEED).abs() < 0.1 * SPEED, "{mode}: {velocity}/s");
}

fn at_speed(mode: OperatingMode, heartbeat: HostHeartbeat) -> Fixture {
    at_speed_with(open(drives(|_| {}), mode, heartbeat), mode)
}

fn velocity(fixture: &Fixture) -> f64 {
    fixture.drive(0, |drive| drive.velocity())
}

fn state(fixture: &Fixture) -> DriveState {
    fixture.drive(0, |drive| drive.state())
}

fn now_ms(fixture: &Fixture) -> f64 {
    fixture.now_ns() as f64 / 1e6
}

/// The next owner of the drives, on the same Port.
fn replace_owner(fixture: &mut Fixture, mode: OperatingMode, heartbeat: HostHeartbeat) {
    let new = Cia402::new(&fixture.port, table(mode, heartbeat), config(heartbeat));
    fixture.cia402 = new.unwrap_or_else(|error| panic!("{error}"));
}

fn silence(fixture: &Fixture, for_ms: u32) {
    fixture.inject(Fault::NodeSilent { node: "drive 0.0/1".into(), for_ms });
}

/// Cycles until frames of the host reach the drive again.
fn until_reached(fixture: &mut Fixture) {
    let syncs = |fixture: &Fixture| fixture.drive(0, |drive| drive.syncs());
    let before = syncs(fixture);
    let mut limit = 10_000;
    while syncs(fixture) == before {
        fixture.step();
        limit -= 1;
        assert!(limit > 0, "{}", fixture.session());
    }
}

#[derive(Clone, Copy, Debug)]
struct Sample {
    /// Since the start of the trace.
    ms: f64,
    state: DriveState,
    velocity: f64,
}

/// State and velocity of the drive in each cycle, until it is at rest and 100 ms longer.
struct Trace(Vec<Sample>);

impl fmt::Display for Trace {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut state = None;
        for sample in &self.0 {
            if state.replace(sample.state) != Some(sample.state) {
                write!(f, "{} at {} ms and {:.0}/s, ", sample.state, sample.ms, sample.velocity)?;
            }
        }
        match self.0.last() {
            Some(last) => write!(f, "{:.0}/s after {} ms", last.velocity, last.ms),
            None => f.write_str("empty"),
        }
    }
}

impl Trace {
    fn of(fixture: &mut Fixture) -> Self {
        let start = now_ms(fixture);
        let mut trace = Self(Vec::new());
        let mut rest_ms = None;
        loop {
            let ms = (now_ms(fixture) - start).round();
            let sample = Sample { ms, state: state(fixture), velocity: velocity(fixture) };
            trace.0.push(sample);
            if sample.velocity.abs() < REST && rest_ms.is_none() {
                rest_ms = Some(ms);
            }
            if ms > WATCH_MS || rest_ms.is_some_and(|rest| ms > rest + 100.0) {
                return trace;
            }
            fixture.step();
        }
    }

    fn rest_ms(&self) -> Option<f64> {
        self.0.iter().find(|sample| sample.velocity.abs() < REST).map(|sample| sample.ms)
    }

    fn until_rest(&self) -> impl Iterator<Item = &Sample> {
        self.0.iter().take_while(|sample| sample.velocity.abs() >= REST)
    }

    /// The motor is at rest within `reaction_ms` and the time of the deceleration.
    fn assert_rest(&self, reaction_ms: f64, deceleration: f64) -> &Self {
        let from = self.0.first().unwrap().velocity.abs();
        // The ramp of the position controller ends slowly.
        let within = reaction_ms + 1_100.0 * from / deceleration + 20.0;
        let is_in_time = self.rest_ms().is_some_and(|rest| rest <= within);
        assert!(is_in_time, "at rest within {within:.0} ms: {self}");
        self
    }

    /// Nothing switched the power off before the motor was at rest.
    fn assert_no_coasting(&self) -> &Self {
        let is_braked = |state| {
            matches!(
                state,
                DriveState::OperationEnabled
                    | DriveState::QuickStopActive
                    | DriveState::FaultReactionActive
            )
        };
        let coasting = self.until_rest().find(|sample| !is_braked(sample.state));
        assert!(coasting.is_none(), "coasting from {coasting:?}: {self}");
        self
    }

    /// After the drive left Operation Enabled it was not enabled again before it was at rest.
    fn assert_not_enabled_before_rest(&self) -> &Self {
        let is_enabled = |sample: &&Sample| sample.state == DriveState::OperationEnabled;
        let again = self.until_rest().skip_while(is_enabled).find(is_enabled);
        assert!(again.is_none(), "enabled again {again:?}: {self}");
        self
    }

    /// The velocity falls at the deceleration of the quick stop, from its first change to rest.
    fn assert_quick_deceleration(&self) -> &Self {
        let from = self.0.first().unwrap().velocity.abs();
        let braking = |sample: &&Sample| (0.1 * from..0.9 * from).contains(&sample.velocity.abs());
        let (first, last) = (self.0.iter().find(braking), self.0.iter().rfind(braking));
        let (Some(first), Some(last)) = (first, last) else { panic!("no braking: {self}") };
        let found = (first.velocity - last.velocity).abs() / (last.ms - first.ms) * 1e3;
        assert!((found - QUICK).abs() < 0.2 * QUICK, "{found:.0} increments/s²: {self}");
        self
    }
}

/// The drive is off or at rest in Quick Stop Active, and remains so without a command.
fn assert_stays_stopped(fixture: &mut Fixture) {
    fixture.steps(500);
    let (state, velocity) = (state(fixture), velocity(fixture));
    assert_ne!(state, DriveState::OperationEnabled, "{:?}", fixture.cia402.progress(0));
    assert!(velocity.abs() < REST, "{velocity}/s in {state}");
}

/// The axis can be used again.
fn assert_runs_again(fixture: &mut Fixture) {
    fixture.cia402.enable(0).unwrap();
    fixture.until(2_000, |cia402| cia402.is_running(0));
    assert_eq!(state(fixture), DriveState::OperationEnabled);
}

// A stop is not cancelled by enabling

#[test]
fn enable_in_the_cycle_of_a_quick_stop_waits_for_rest() {
    use OperatingMode as M;
    for mode in [M::CyclicVelocity, M::CyclicTorque, M::ProfileVelocity, M::CyclicPosition] {
        let mut fixture = at_speed(mode, HostHeartbeat::On);
        fixture.cia402.set_target_step(0, 0).unwrap();
        fixture.cia402.quick_stop(0).unwrap();
        fixture.cia402.enable(0).unwrap();
        let trace = Trace::of(&mut fixture);
        println!("{mode}: {trace}");
        trace.assert_rest(REACTION_MS, QUICK).assert_no_coasting();
        trace.assert_not_enabled_before_rest().assert_quick_deceleration();
        fixture.until(2_000, |cia402| cia402.is_running(0));
        fixture.idle(100);
        assert!(velocity(&fixture).abs() < REST, "{mode}: {}/s", velocity(&fixture));
    }
}

#[test]
fn enable_during_quick_stop_braking_does_not_coast() {
    for cycles in [1, 3, 10, 40, 90] {
        let mut fixture = at_speed(OperatingMode::CyclicPosition, HostHeartbeat::On);
        fixture.cia402.quick_stop(0).unwrap();
        fixture.steps(cycles);
        fixture.cia402.set_target_step(0, 0).unwrap();
        fixture.cia402.enable(0).unwrap();
        let trace = Trace::of(&mut fixture);
        println!("enabled {cycles} cycles after the quick stop: {trace}");
        trace.assert_rest(REACTION_MS, QUICK).assert_no_coasting();
        trace.assert_not_enabled_before_rest();
        fixture.until(2_000, |cia402| cia402.is_running(0));
        fixture.check();
    }
}

/// The command may be rejected, or wait for the end of the stop.
fn ignore<E>(_: Result<(), E>) {}

#[test]
fn other_commands_during_quick_stop_braking_do_not_coast() {
    type Command = fn(&mut Cia402);
    let commands: [(&str, Command); 6] = [
        ("disable", |cia402| cia402.disable(0).unwrap()),
        ("configure", |cia402| ignore(cia402.configure(0))),
        ("change mode", |cia402| ignore(cia402.change_mode(0, OperatingMode::ProfilePosition))),
        ("home", |cia402| ignore(cia402.home(0, HomingConfig::new(35)))),
        ("reset fault", |cia402| ignore(cia402.reset_fault(0))),
        ("shutdown", Cia402::begin_shutdown),
    ];
    for (name, command) in commands {
        let mut fixture = at_speed(OperatingMode::CyclicPosition, HostHeartbeat::On);
        fixture.cia402.quick_stop(0).unwrap();
        fixture.steps(10);
        command(&mut fixture.cia402);
        let trace = Trace::of(&mut fixture);
        println!("{name} 10 cycles after the quick stop: {trace}");
        trace.assert_rest(REACTION_MS, QUICK).assert_no_coasting();
        trace.assert_not_enabled_before_rest();
    }
}

/// A hold of the guard stops the axis in a rate mode; an operator enables it at once.
#[test]
fn enable_after_an_unsent_automatic_stop_waits_for_rest() {
    let faults = [
        // Shorter than the time in which the drive detects the loss of the host, and longer.
        Fault::LostFrame { direction: LossDirection::Outward, cycles: 100 },
        Fault::LostFrame { direction: LossDirection::Outward, cycles: 150 },
        Fault::LostFrame { direction: LossDirection::Return, cycles: 100 },
        Fault::BusOff { gateway: 0, channel: 0 },
        Fault::LinkLoss { gateway: 0, for_ms: 300 },
        Fault::PowerCycle { gateway: 0, off_ms: 300 },
    ];
    for fault in faults {
        for heartbeat in [HostHeartbeat::On, HostHeartbeat::Off] {
            let mut fixture = at_speed(OperatingMode::CyclicVelocity, heartbeat);
            fixture.inject(fault.clone());
            fixture.until(500, |cia402| !cia402.is_running(0));
            fixture.cia402.enable(0).unwrap();
            let injected_ms = now_ms(&fixture);
            let mut trace = Trace(Vec::new());
            let (mut syncs, mut gap_ms, mut back_ms) = (0, 0.0, 0.0);
            // Until all is back and the axis runs as the operator commanded.
            for _ in 0..15_000 {
                let ms = (now_ms(&fixture) - injected_ms).round();
                let sample = Sample { ms, state: state(&fixture), velocity: velocity(&fixture) };
                trace.0.push(sample);
                // The end of the last gap of 20 ms without frames of the host.
                let received = fixture.drive(0, |drive| drive.syncs());
                if std::mem::replace(&mut syncs, received) != received {
                    if ms > gap_ms + 20.0 {
                        back_ms = ms;
                    }
                    gap_ms = ms;
                }
                if fixture.cia402.is_running(0) && ms > back_ms + 500.0 {
                    break;
                }
                fixture.step();
            }
            println!("{fault:?}, host heartbeat {heartbeat:?}: back at {back_ms} ms, {trace}");
            trace.assert_no_coasting().assert_not_enabled_before_rest();
            trace.assert_rest(back_ms + RETURN_MS, QUICK);
            assert!(fixture.cia402.is_running(0), "{:?}", fixture.cia402.progress(0));
            assert!(velocity(&fixture).abs() < REST, "{}/s", velocity(&fixture));
        }
    }
}

#[test]
fn enable_during_automatic_braking_does_not_coast() {
    for cycles in [1, 3, 10, 40] {
        let mut fixture = at_speed(OperatingMode::CyclicVelocity, HostHeartbeat::On);
        fixture.inject(Fault::LostFrame { direction: LossDirection::Outward, cycles: 6 });
        fixture.until(500, |cia402| !cia402.is_running(0));
        let mut limit = 100;
        while state(&fixture) == DriveState::OperationEnabled && limit > 0 {
            fixture.step();
            limit -= 1;
        }
        fixture.steps(cycles);
        fixture.cia402.enable(0).unwrap();
        let trace = Trace::of(&mut fixture);
        println!("enabled {cycles} cycles into the braking: {trace}");
        trace.assert_rest(REACTION_MS, QUICK).assert_no_coasting();
        trace.assert_not_enabled_before_rest();
        fixture.until(2_000, |cia402| cia402.is_running(0));
    }
}

// A stop acts in every state of the axis

/// A stop call on the axis.
type StopCall = (&'static str, fn(&mut Cia402), f64);

const STOP_CALLS: [StopCall; 4] = [
    ("quick_stop", |cia402| cia402.quick_stop(0).unwrap(), QUICK),
    ("quick_stop_all", Cia402::quick_stop_all, QUICK),
    ("disable", |cia402| cia402.disable(0).unwrap(), PROFILE),
    ("disable_all", Cia402::disable_all, PROFILE),
];

#[test]
fn stop_after_a_failed_configuration_reaches_the_drive() {
    for (name, stop, deceleration) in STOP_CALLS {
        for once in [true, false] {
            let mut fixture = at_speed(OperatingMode::CyclicVelocity, HostHeartbeat::On);
            silence(&fixture, 3_000);
            let silent_ms = now_ms(&fixture);
            fixture.steps(5);
            fixture.cia402.configure(0).unwrap();
            fixture.steps(900);
            let before = velocity(&fixture);
            let start_ms = now_ms(&fixture);
            stop(&mut fixture.cia402);
            while now_ms(&fixture) < silent_ms + 3_000.0 {
                if !once {
                    stop(&mut fixture.cia402);
                }
                fixture.step();
            }
            let returned_ms = now_ms(&fixture) - start_ms;
            let trace = Trace::of(&mut fixture);
            println!(
                "{name}, once {once}: {before:.0}/s at the call, returned {returned_ms:.0} ms \
                 later: {trace}"
            );
            trace.assert_rest(RETURN_MS, deceleration).assert_no_coasting();
            assert_stays_stopped(&mut fixture);
        }
    }
}

#[test]
fn stop_of_a_drive_of_an_earlier_owner_reaches_it() {
    for (name, stop, deceleration) in STOP_CALLS {
        for mode in RATE_AND_PROFILE_MODES {
            let mut fixture = at_speed(mode, HostHeartbeat::Off);
            replace_owner(&mut fixture, mode, HostHeartbeat::Off);
            stop(&mut fixture.cia402);
            let trace = Trace::of(&mut fixture);
            println!("{name}, {mode}: {trace}");
            trace.assert_rest(RETURN_MS, deceleration).assert_no_coasting();
            assert_stays_stopped(&mut fixture);
        }
    }
}

#[test]
fn configure_of_a_moving_axis_does_not_coast() {
    for mode in [OperatingMode::CyclicVelocity, OperatingMode::CyclicPosition] {
        let mut fixture = at_speed(mode, HostHeartbeat::On);
        fixture.cia402.configure(0).unwrap();
        let trace = Trace::of(&mut fixture);
        println!("configure, {mode}: {trace}");
        trace.assert_rest(RETURN_MS, QUICK).assert_no_coasting();
        fixture.until(2_000, |cia402| cia402.phase(0) == Some(AxisPhase::Standby));
    }
}

#[test]
fn quick_stop_during_configuration_stops_the_motor() {
    for cycles in [0, 1, 2, 3, 5, 8, 20, 40] {
        let mut fixture = at_speed(OperatingMode::CyclicVelocity, HostHeartbeat::On);
        fixture.cia402.configure(0).unwrap();
        fixture.steps(cycles);
        fixture.cia402.quick_stop(0).unwrap();
        let trace = Trace::of(&mut fixture);
        println!("quick stop {cycles} cycles after configure: {trace}");
        trace.assert_rest(RETURN_MS, QUICK).assert_no_coasting();
        assert_stays_stopped(&mut fixture);
    }
}

#[test]
fn quick_stop_while_the_mode_is_set_keeps_the_drive_off() {
    let scenario = drives(|drive| drive.quirks.mode_delay_ms = 300);
    let mut fixture = open(scenario, OperatingMode::CyclicVelocity, HostHeartbeat::On);
    fixture.cia402.configure_all().unwrap();
    fixture.until(1_000, |cia402| matches!(cia402.phase(0), Some(AxisPhase::SettingMode(_))));
    fixture.cia402.quick_stop(0).unwrap();
    assert_stays_stopped(&mut fixture);
    fixture.cia402.configure(0).unwrap();
    fixture.until(1_000, |cia402| cia402.phase(0) == Some(AxisPhase::Standby));
    assert_runs_again(&mut fixture);
}

/// The drive ran on while its gateway was away: its configuration has to be verified first.
#[test]
fn quick_stop_during_verification_stops_the_motor() {
    for mode in [OperatingMode::CyclicVelocity, OperatingMode::ProfileVelocity] {
        for cycles in [0, 1, 2, 5] {
            let mut fixture = at_speed(mode, HostHeartbeat::Off);
            fixture.inject(Fault::PowerCycle { gateway: 0, off_ms: 200 });
            fixture.steps(100);
            fixture.cia402.quick_stop(0).unwrap();
            until_reached(&mut fixture);
            fixture.steps(cycles);
            fixture.cia402.quick_stop(0).unwrap();
            let trace = Trace::of(&mut fixture);
            println!("{mode}, {cycles} cycles after the return of the gateway: {trace}");
            trace.assert_rest(RETURN_MS, QUICK).assert_no_coasting();
            assert_stays_stopped(&mut fixture);
        }
    }
}

#[test]
fn quick_stop_while_enabling_ends_off() {
    for cycles in [0, 1, 2, 5, 20, 45, 60] {
        let scenario = drives(|drive| drive.enable_ms = 100);
        let mut fixture =
            open(scenario, OperatingMode::CyclicVelocity, HostHeartbeat::On).started();
        fixture.cia402.disable(0).unwrap();
        fixture.until(500, |cia402| cia402.drive_state(0) == Some(DriveState::SwitchOnDisabled));
        fixture.cia402.enable(0).unwrap();
        fixture.steps(cycles);
        fixture.cia402.quick_stop(0).unwrap();
        assert_stays_stopped(&mut fixture);
        assert_runs_again(&mut fixture);
    }
}

#[test]
fn quick_stop_during_homing_stops_the_motor() {
    let mut fixture = open(drives(|_| {}), OperatingMode::CyclicPosition, HostHeartbeat::On);
    fixture.start();
    fixture.cia402.home(0, HomingConfig::new(19)).unwrap();
    let mut limit = 5_000;
    while velocity(&fixture).abs() < 100_000.0 && limit > 0 {
        fixture.idle(1);
        limit -= 1;
    }
    assert!(matches!(fixture.cia402.phase(0), Some(AxisPhase::Homing(_))));
    fixture.cia402.quick_stop(0).unwrap();
    let trace = Trace::of(&mut fixture);
    println!("homing: {trace}");
    trace.assert_rest(REACTION_MS, QUICK).assert_no_coasting();
    assert_stays_stopped(&mut fixture);
}

#[test]
fn quick_stop_during_a_mode_change_stops_the_motor() {
    for cycles in [0, 1, 3, 20, 60, 100, 120, 140] {
        let mut fixture = at_speed(OperatingMode::CyclicPosition, HostHeartbeat::On);
        fixture.cia402.change_mode(0, OperatingMode::ProfilePosition).unwrap();
        fixture.steps(cycles);
        fixture.cia402.quick_stop(0).unwrap();
        let trace = Trace::of(&mut fixture);
        println!("quick stop {cycles} cycles after change_mode: {trace}");
        trace.assert_rest(REACTION_MS, QUICK).assert_no_coasting();
        assert_stays_stopped(&mut fixture);
    }
}

#[test]
fn quick_stop_in_fault_reaction_does_not_coast() {
    for cycles in [0, 5, 20, 150] {
        let mut fixture = at_speed(OperatingMode::CyclicVelocity, HostHeartbeat::On);
        fixture.strike(0, DriveFault::Error { code: 0x2310 });
        fixture.steps(cycles);
        fixture.cia402.quick_stop(0).unwrap();
        let trace = Trace::of(&mut fixture);
        println!("quick stop {cycles} cycles after the fault: {trace}");
        trace.assert_rest(REACTION_MS, QUICK).assert_no_coasting();
        assert_stays_stopped(&mut fixture);
    }
}

#[test]
fn quick_stop_during_a_fault_reset_keeps_the_drive_off() {
    for cycles in [0, 1, 3, 6, 10] {
        let mut fixture = at_speed(OperatingMode::CyclicVelocity, HostHeartbeat::On);
        fixture.strike(0, DriveFault::Error { code: 0x2310 });
        fixture.until(500, |cia402| cia402.drive_state(0) == Some(DriveState::Fault));
        fixture.cia402.reset_fault(0).unwrap();
        fixture.steps(cycles);
        fixture.cia402.quick_stop(0).unwrap();
        assert_stays_stopped(&mut fixture);
        fixture.cia402.reset_fault(0).unwrap();
        fixture.steps(50);
        assert_runs_again(&mut fixture);
    }
}

/// A drive that coasts in Fault must not be enabled while it moves.
#[test]
fn coasting_drive_is_not_enabled_before_rest() {
    let mut axis = axis_in(OperatingMode::CyclicVelocity);
    let coasts = FaultReaction::Disable.raw();
    axis.drive.further.push(Step::write(object::FAULT_REACTION_OPTION, 0, coasts));
    let fixture = Fixture::with(drives(|_| {}), vec![axis]);
    let mut fixture = at_speed_with(fixture, OperatingMode::CyclicVelocity);
    fixture.strike(0, DriveFault::Error { code: 0x2310 });
    fixture.until(500, |cia402| cia402.drive_state(0) == Some(DriveState::Fault));
    fixture.cia402.reset_fault(0).unwrap();
    fixture.steps(50);
    assert_ne!(state(&fixture), DriveState::Fault);
    fixture.cia402.enable(0).unwrap();
    Trace::of(&mut fixture).assert_rest(0.0, 100_000.0).assert_not_enabled_before_rest();
    fixture.until(2_000, |cia402| cia402.is_running(0));
}

// A stop acts while nothing can be sent

#[test]
fn quick_stop_during_bus_off_acts_on_recovery() {
    use OperatingMode as M;
    for mode in [M::CyclicVelocity, M::CyclicTorque, M::ProfileVelocity, M::CyclicPosition] {
        for cycles in [0, 1, 3] {
            let mut fixture = at_speed(mode, HostHeartbeat::Off);
            fixture.inject(Fault::BusOff { gateway: 0, channel: 0 });
            fixture.steps(cycles);
            fixture.cia402.quick_stop(0).unwrap();
            let trace = Trace::of(&mut fixture);
            println!("{mode}, {cycles} cycles after bus-off: {trace}");
            trace.assert_rest(RETURN_MS, QUICK).assert_no_coasting();
            assert_stays_stopped(&mut fixture);
        }
    }
}

#[test]
fn quick_stop_while_frames_are_lost_acts_on_return() {
    for direction in [LossDirection::Outward, LossDirection::Return] {
        for mode in RATE_AND_PROFILE_MODES {
            let mut fixture = at_speed(mode, HostHeartbeat::Off);
            fixture.inject(Fault::LostFrame { direction, cycles: 150 });
            fixture.steps(2);
            fixture.cia402.quick_stop(0).unwrap();
            fixture.steps(148);
            until_reached(&mut fixture);
            let trace = Trace::of(&mut fixture);
            println!("{mode}, {direction:?}: {trace}");
            trace.assert_rest(RETURN_MS, QUICK).assert_no_coasting();
            assert_stays_stopped(&mut fixture);
        }
    }
}

#[test]
fn quick_stop_of_a_silent_drive_acts_and_is_confirmed() {
    let mut fixture = at_speed(OperatingMode::CyclicVelocity, HostHeartbeat::On);
    silence(&fixture, 1_000);
    fixture.steps(2);
    fixture.cia402.quick_stop(0).unwrap();
    // The drive receives, although it sends nothing.
    Trace::of(&mut fixture).assert_rest(REACTION_MS, QUICK).assert_no_coasting();
    fixture.until(1_000, |cia402| cia402.drive_state(0) == Some(DriveState::SwitchOnDisabled));
    assert_stays_stopped(&mut fixture);
}

#[test]
fn shutdown_stops_an_unconfigured_moving_axis() {
    for mode in RATE_AND_PROFILE_MODES {
        let mut fixture = at_speed(mode, HostHeartbeat::Off);
        replace_owner(&mut fixture, mode, HostHeartbeat::Off);
        let result = fixture.cia402.shutdown_timeout(&mut fixture.port, START, |_| {});
        let (state, velocity) = (state(&fixture), velocity(&fixture));
        println!("{mode}: {result:?}, {velocity:.0}/s in {state}");
        assert!(velocity.abs() < REST, "{mode}: {velocity}/s in {state}");
        assert_eq!(state, DriveState::SwitchOnDisabled, "{mode}");
        result.unwrap();
    }
}

#[test]
fn shutdown_reports_a_moving_axis_that_it_cannot_reach() {
    let mut fixture = at_speed(OperatingMode::CyclicVelocity, HostHeartbeat::Off);
    fixture.inject(Fault::LostFrame { direction: LossDirection::Outward, cycles: 100_000 });
    replace_owner(&mut fixture, OperatingMode::CyclicVelocity, HostHeartbeat::Off);
    let limit = Duration::from_secs(2);
    let result = fixture.cia402.shutdown_timeout(&mut fixture.port, limit, |_| {});
    println!("{result:?}, {:.0}/s", velocity(&fixture));
    assert!(result.is_err(), "{:.0}/s in {}", velocity(&fixture), state(&fixture));
}

// A new owner

/// COB-IDs of SYNC and of the heartbeat of the host, by which a drive continues.
fn feeds(frame: &ecan_sim::BusFrame) -> bool {
    let id = frame.frame.id();
    id == CobId::SYNC.can_id() || id == CobId::heartbeat(NodeId::MAX).can_id()
}

#[test]
fn new_owner_stops_moving_drives_before_it_feeds_them() {
    for heartbeat in [HostHeartbeat::On, HostHeartbeat::Off] {
        for mode in RATE_AND_PROFILE_MODES {
            let mut fixture = at_speed(mode, heartbeat);
            fixture.simulation.with_world(|world| world.record_bus_of(0, 0));
            replace_owner(&mut fixture, mode, heartbeat);
            // Frames of the old owner, which the Port and the gateway still hold.
            fixture.steps(3);
            fixture.simulation.with_world(ecan_sim::World::take_recorded);
            let mut before_stop = Vec::new();
            let mut limit = 2_500;
            while state(&fixture) == DriveState::OperationEnabled && limit > 0 {
                fixture.step();
                limit -= 1;
                let frames = fixture.simulation.with_world(ecan_sim::World::take_recorded);
                if state(&fixture) == DriveState::OperationEnabled {
                    before_stop.extend(frames.into_iter().filter(|it| it.is_from_channel));
                }
            }
            let fed = before_stop.iter().filter(|frame| feeds(frame)).count();
            let trace = Trace::of(&mut fixture);
            println!("{mode}, host heartbeat {heartbeat:?}: {fed} frames fed, {trace}");
            assert!(limit > 2_450, "stopped within 100 ms: {trace}");
            trace.assert_rest(RETURN_MS, QUICK).assert_no_coasting();
            assert_eq!(fed, 0, "SYNC and heartbeats before the stop");
            assert_stays_stopped(&mut fixture);
            fixture.start();
            accelerate(&mut fixture, mode);
        }
    }
}

#[test]
fn new_owner_configures_a_moving_drive_after_its_stop() {
    for heartbeat in [HostHeartbeat::On, HostHeartbeat::Off] {
        let mode = OperatingMode::CyclicVelocity;
        let mut fixture = at_speed(mode, heartbeat);
        replace_owner(&mut fixture, mode, heartbeat);
        fixture.cia402.configure_all().unwrap();
        let trace = Trace::of(&mut fixture);
        println!("host heartbeat {heartbeat:?}: {trace}");
        trace.assert_rest(RETURN_MS, QUICK).assert_no_coasting();
        fixture.until(2_000, |cia402| cia402.phase(0) == Some(AxisPhase::Standby));
        assert_runs_again(&mut fixture);
    }
}

#[test]
fn new_owner_leaves_drives_off_that_were_off() {
    let mode = OperatingMode::CyclicVelocity;
    let mut fixture = open(drives(|_| {}), mode, HostHeartbeat::On).started();
    fixture.cia402.disable(0).unwrap();
    fixture.until(500, |cia402| cia402.drive_state(0) == Some(DriveState::SwitchOnDisabled));
    replace_owner(&mut fixture, mode, HostHeartbeat::On);
    assert_stays_stopped(&mut fixture);
    fixture.start();
}

/// A drive that does not answer SDO requests must not keep the channel from its SYNC.
#[test]
fn new_owner_continues_without_a_mute_drive() {
    let rule = SdoRule {
        index: object::STATUSWORD,
        subindex: None,
        direction: SdoDirection::Read,
        effect: SdoEffect::Abort(AbortCode::NO_OBJECT),
        times: None,
    };
    let scenario = drives(|drive| {
        if drive.node.get() == 1 {
            drive.quirks.sdo_rules.push(rule);
        }
    });
    let mut fixture = open(scenario, OperatingMode::CyclicVelocity, HostHeartbeat::On);
    fixture.start();
    fixture.check();
}

// Drives with their own mind

#[test]
fn drive_that_ignores_quick_stop_is_stopped_by_disable() {
    let scenario = drives(|drive| drive.quirks.ignores_quick_stop = true);
    let mode = OperatingMode::CyclicVelocity;
    let mut fixture = at_speed_with(open(scenario, mode, HostHeartbeat::On), mode);
    fixture.cia402.quick_stop(0).unwrap();
    fixture.steps(250);
    println!("500 ms after an ignored quick stop: {:.0}/s", velocity(&fixture));
    fixture.cia402.disable(0).unwrap();
    Trace::of(&mut fixture).assert_rest(REACTION_MS, PROFILE).assert_no_coasting();
    assert_stays_stopped(&mut fixture);
}

// What the axis reports

#[test]
fn halted_axis_is_not_running() {
    use OperatingMode as M;
    for mode in [M::CyclicPosition, M::CyclicVelocity, M::ProfileVelocity, M::ProfilePosition] {
        let mut fixture = at_speed(mode, HostHeartbeat::On);
        assert!(fixture.cia402.is_running(0) && fixture.cia402.all_running());
        fixture.cia402.halt(0).unwrap();
        fixture.steps(1);
        assert!(!fixture.cia402.is_running(0), "{mode}: while it decelerates");
        fixture.until(2_000, |cia402| cia402.is_at_rest(0));
        fixture.steps(10);
        assert!(!fixture.cia402.is_running(0) && !fixture.cia402.all_running(), "{mode}: at rest");
        fixture.cia402.resume(0).unwrap();
        fixture.steps(1);
        assert!(fixture.cia402.is_running(0) && fixture.cia402.all_running(), "{mode}: resumed");
    }
}

#[test]
fn stop_all_stops_every_axis_and_switches_off_at_rest() {
    for mode in RATE_AND_PROFILE_MODES {
        for is_configured in [true, false] {
            let mut fixture = at_speed(mode, HostHeartbeat::Off);
            if !is_configured {
                replace_owner(&mut fixture, mode, HostHeartbeat::Off);
            }
            fixture.cia402.stop_all();
            assert!(!fixture.cia402.all_stopped());
            let trace = Trace::of(&mut fixture);
            println!("{mode}, configured {is_configured}: {trace}");
            trace.assert_rest(RETURN_MS, QUICK).assert_no_coasting();
            fixture.until(500, Cia402::all_stopped);
            assert_eq!(state(&fixture), DriveState::SwitchOnDisabled);
        }
    }
}

#[test]
fn stop_all_timeout_returns_at_rest() {
    let mut fixture = at_speed(OperatingMode::CyclicVelocity, HostHeartbeat::On);
    fixture.cia402.stop_all_timeout(&mut fixture.port, START, |_| {}).unwrap();
    assert!(velocity(&fixture).abs() < REST && fixture.cia402.all_stopped());
    assert_eq!(state(&fixture), DriveState::SwitchOnDisabled);
}

#[test]
fn all_stopped_is_false_while_a_drive_ignores_the_stop() {
    let scenario = drives(|drive| drive.quirks.ignores_quick_stop = true);
    let mode = OperatingMode::CyclicVelocity;
    let mut fixture = at_speed_with(open(scenario, mode, HostHeartbeat::On), mode);
    fixture.cia402.quick_stop(0).unwrap();
    fixture.step();
    while !fixture.cia402.all_stopped() {
        assert!(matches!(fixture.cia402.phase(0), Some(AxisPhase::Stopping(_))));
        fixture.step();
    }
    assert!(velocity(&fixture).abs() < REST);
}

#[test]
fn moving_axis_out_of_reach_is_uncontrolled() {
    let mut fixture = at_speed(OperatingMode::CyclicVelocity, HostHeartbeat::Off);
    fixture.inject(Fault::LostFrame { direction: LossDirection::Outward, cycles: 500 });
    fixture.steps(250);
    assert!(matches!(fixture.cia402.phase(0), Some(AxisPhase::Uncontrolled(StopCause::Held(_)))));
    fixture.cia402.quick_stop(0).unwrap();
    fixture.steps(1);
    let commanded = AxisPhase::Uncontrolled(StopCause::QuickStop);
    assert_eq!(fixture.cia402.phase(0), Some(commanded));
    assert_eq!(fixture.cia402.statistics(0).uncontrolled, 1);
    assert!(!fixture.cia402.all_stopped());
    fixture.until(2_000, Cia402::all_stopped);
    assert!(velocity(&fixture).abs() < REST);
}

#[test]
fn automatic_stop_reports_its_reason() {
    let mut fixture = at_speed(OperatingMode::CyclicVelocity, HostHeartbeat::On);
    fixture.inject(Fault::LostFrame { direction: LossDirection::Outward, cycles: 6 });
    fixture.until(500, |cia402| !cia402.is_running(0));
    let reason = fixture.cia402.statistics(0).last_hold.unwrap();
    let cause = StopCause::Held(reason);
    assert_eq!(fixture.cia402.phase(0), Some(AxisPhase::Stopping(cause)));
    fixture.until(500, |cia402| cia402.phase(0) == Some(AxisPhase::Stopped(cause)));
    fixture.cia402.quick_stop(0).unwrap();
    fixture.until(500, |cia402| cia402.phase(0) == Some(AxisPhase::Stopped(StopCause::QuickStop)));
}

/// Replaces the owner by one that adopts enabled drives.
fn adopt(fixture: &mut Fixture, mode: OperatingMode) {
    let settings = Cia402Config { takeover: Takeover::Adopt, ..config(HostHeartbeat::On) };
    let new = Cia402::new(&fixture.port, table(mode, HostHeartbeat::On), settings);
    fixture.cia402 = new.unwrap_or_else(|error| panic!("{error}"));
}

#[test]
fn drive_at_rest_is_adopted_without_being_switched_off() {
    for mode in [OperatingMode::CyclicPosition, OperatingMode::CyclicVelocity] {
        let mut fixture = open(drives(|_| {}), mode, HostHeartbeat::On);
        fixture.start();
        fixture.idle(100);
        adopt(&mut fixture, mode);
        for _ in 0..100 {
            fixture.step();
            assert_eq!(state(&fixture), DriveState::OperationEnabled, "{mode}");
        }
        assert!(fixture.cia402.is_configured(0), "{mode}: {:?}", fixture.cia402.phase(0));
        fixture.cia402.enable(0).unwrap();
        fixture.until(500, Cia402::all_running);
        assert_eq!(state(&fixture), DriveState::OperationEnabled, "{mode}");
        fixture.check();
    }
}

#[test]
fn moving_drive_is_not_adopted() {
    let mode = OperatingMode::CyclicVelocity;
    let mut fixture = at_speed(mode, HostHeartbeat::On);
    adopt(&mut fixture, mode);
    Trace::of(&mut fixture).assert_rest(400.0, QUICK).assert_no_coasting();
    assert!(!fixture.cia402.is_configured(0));
}

#[test]
fn drive_in_another_mode_is_not_adopted() {
    let mut fixture = open(drives(|_| {}), OperatingMode::CyclicVelocity, HostHeartbeat::On);
    fixture.start();
    adopt(&mut fixture, OperatingMode::CyclicPosition);
    fixture.until(500, Cia402::all_stopped);
    assert!(!fixture.cia402.is_configured(0));
    assert_eq!(state(&fixture), DriveState::SwitchOnDisabled);
}

#[test]
fn fault_reset_without_a_fault_changes_nothing() {
    for mode in RATE_AND_PROFILE_MODES {
        let mut fixture = at_speed(mode, HostHeartbeat::On);
        fixture.cia402.reset_fault(0).unwrap();
        fixture.steps(100);
        assert!(fixture.cia402.is_running(0), "{mode}: {:?}", fixture.cia402.phase(0));
        fixture.cia402.quick_stop(0).unwrap();
        fixture.cia402.reset_fault(0).unwrap();
        Trace::of(&mut fixture).assert_rest(REACTION_MS, QUICK).assert_no_coasting();
    }
}

#[test]
fn quick_stop_while_the_brake_opens_switches_off() {
    let scenario = drives(|drive| drive.enable_ms = 100);
    let mut fixture = open(scenario, OperatingMode::CyclicVelocity, HostHeartbeat::On);
    let port = &mut fixture.port;
    fixture.cia402.configure_all_timeout(port, START, |_| {}).unwrap();
    fixture.cia402.enable(0).unwrap();
    fixture.until(500, |cia402| cia402.drive_state(0) == Some(DriveState::SwitchedOn));
    fixture.steps(10);
    fixture.cia402.quick_stop(0).unwrap();
    for _ in 0..200 {
        fixture.step();
        assert_ne!(state(&fixture), DriveState::OperationEnabled);
    }
    assert_eq!(state(&fixture), DriveState::SwitchOnDisabled);
}

#[test]
fn drive_silent_at_the_first_contact_is_stopped_when_it_answers() {
    for is_configured in [false, true] {
        let mode = OperatingMode::CyclicVelocity;
        let mut fixture = at_speed(mode, HostHeartbeat::Off);
        fixture.inject(Fault::NodeSilent { node: "drive 0.0/1".to_owned(), for_ms: 1_500 });
        replace_owner(&mut fixture, mode, HostHeartbeat::Off);
        if is_configured {
            fixture.cia402.configure(0).unwrap();
        }
        fixture.steps(725);
        assert!(velocity(&fixture) > 0.9 * SPEED, "it is not reached before");
        Trace::of(&mut fixture).assert_rest(1_000.0, QUICK).assert_no_coasting();
    }
}

#[test]
fn drive_that_opens_its_brake_at_the_takeover_is_switched_off() {
    let scenario = drives(|drive| drive.enable_ms = 100);
    let mode = OperatingMode::CyclicVelocity;
    let mut fixture = open(scenario, mode, HostHeartbeat::Off);
    fixture.cia402.configure_all_timeout(&mut fixture.port, START, |_| {}).unwrap();
    fixture.cia402.enable(0).unwrap();
    fixture.until(500, |cia402| cia402.drive_state(0) == Some(DriveState::SwitchedOn));
    fixture.steps(5);
    replace_owner(&mut fixture, mode, HostHeartbeat::Off);
    fixture.until(500, Cia402::all_stopped);
    fixture.steps(200);
    assert_eq!(state(&fixture), DriveState::SwitchOnDisabled);
}

#[test]
fn axis_is_configured_again_after_a_shutdown() {
    let mode = OperatingMode::CyclicPosition;
    let mut fixture = open(drives(|_| {}), mode, HostHeartbeat::On);
    fixture.start();
    fixture.cia402.shutdown_timeout(&mut fixture.port, START, |_| {}).unwrap();
    assert!(fixture.cia402.enable(0).is_err(), "its drive does not watch the host");
    fixture.cia402.configure(0).unwrap();
    fixture.until(500, |cia402| cia402.is_configured(0));
    fixture.cia402.enable(0).unwrap();
    fixture.until(1_000, Cia402::all_running);
}

#[test]
fn halt_and_configure_end_a_recovery() {
    let mode = OperatingMode::CyclicPosition;
    let mut fixture = open(drives(|_| {}), mode, HostHeartbeat::On);
    fixture.start();
    fixture.cia402.recover(0).unwrap();
    fixture.cia402.halt(0).unwrap();
    fixture.steps(100);
    assert_eq!(fixture.cia402.phase(0), Some(AxisPhase::Halted));
    fixture.cia402.quick_stop(0).unwrap();
    fixture.cia402.recover(0).unwrap();
    fixture.cia402.configure(0).unwrap();
    fixture.steps(500);
    assert!(fixture.cia402.is_configured(0) && !fixture.cia402.is_recovering(0));
    assert_eq!(state(&fixture), DriveState::SwitchOnDisabled);
}

#[test]
fn recovery_returns_from_hold_fault_and_restart() {
    let mode = OperatingMode::CyclicVelocity;
    type Strike = fn(&Fixture);
    let faults: [(&str, Strike); 4] = [
        ("hold", |fixture| {
            fixture.inject(Fault::LostFrame { direction: LossDirection::Outward, cycles: 6 });
        }),
        ("fault", |fixture| fixture.strike(0, DriveFault::Error { code: 0x2310 })),
        ("restart", |fixture| fixture.strike(0, DriveFault::PowerCycle { off_ms: 100 })),
        ("gateway", |fixture| fixture.inject(Fault::PowerCycle { gateway: 0, off_ms: 100 })),
    ];
    for (name, fault) in faults {
        let mut fixture = at_speed(mode, HostHeartbeat::On);
        fault(&fixture);
        fixture.until(1_000, |cia402| !cia402.all_running());
        let recovered = fixture.cia402.recover_all_timeout(&mut fixture.port, START, |_| {});
        recovered.unwrap_or_else(|error| panic!("{name}: {error}"));
        assert!(fixture.cia402.all_running(), "{name}");
    }
}

#[test]
fn recovery_refuses_a_persistent_fault_and_a_shutdown() {
    let scenario = drives(|drive| drive.quirks.stuck_in_fault = true);
    let mut fixture = open(scenario, OperatingMode::CyclicPosition, HostHeartbeat::On);
    fixture.start();
    fixture.strike(0, DriveFault::Error { code: 0x7305 });
    fixture.until(500, |cia402| cia402.phase(0) == Some(AxisPhase::Fault));
    let recovered = fixture.cia402.recover_all_timeout(&mut fixture.port, START, |_| {});
    let text = recovered.unwrap_err().to_string();
    assert!(text.contains("0x7305"), "{text}");
    fixture.cia402.begin_shutdown();
    let rejected = fixture.cia402.recover(0);
    assert!(matches!(rejected, Err(CommandError::ShuttingDown { axis: 0 })), "{rejected:?}");
}
