//! Drives that move before a stop, and the trace of their velocity.
//!
//! The motor turns at 200,000 increments/s. A quick stop (0x6085) takes 200 ms, a slow down
//! (0x6084) 1 s, coasting by friction 2 s, so the trace of the velocity shows which one it was.

use std::fmt;
use std::time::Duration;

use ecan_canopen::{DriveState, OperatingMode, Step, object};
use ecan_cia402::{AxisConfig, Cia402, Cia402Config};
use ecan_sim::{DriveConfig, Fault, Scenario};

use crate::axes::{Fixture, axis, scenario};

/// Velocity before a stop, increments per second.
pub const SPEED: f64 = 200_000.0;
/// Quick stop deceleration 0x6085 of the drives, increments per second squared.
pub const QUICK: f64 = 1_000_000.0;
/// Profile deceleration 0x6084.
pub const PROFILE: f64 = 200_000.0;
/// Velocity at which the drive regards its motor as settled.
pub const REST: f64 = 656.0;
/// Longest time from the call to the deceleration if frames can leave: S + 4 C + B (docs/SAFETY.md).
pub const REACTION_MS: f64 = 12.0;
/// Longest time from the return of a drive, channel or gateway to the deceleration.
pub const RETURN_MS: f64 = 100.0;
/// Time for which a drive is watched that does not stop.
pub const WATCH_MS: f64 = 5_000.0;

pub const RATE_AND_PROFILE_MODES: [OperatingMode; 4] = [
    OperatingMode::CyclicVelocity,
    OperatingMode::CyclicTorque,
    OperatingMode::ProfileVelocity,
    OperatingMode::ProfilePosition,
];

/// Motors with little friction, whose 0x6085 is [`QUICK`] and 0x6084 [`PROFILE`].
pub fn drives(change: impl Fn(&mut DriveConfig)) -> Scenario {
    scenario(1, |drive| {
        drive.motor.max_acceleration = 4_000_000;
        drive.motor.friction = 100_000;
        change(drive);
    })
}

pub fn axis_in(mode: OperatingMode) -> AxisConfig {
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

/// Watch of the host by the drives.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum HostHeartbeat {
    On,
    Off,
}

pub fn table(mode: OperatingMode, heartbeat: HostHeartbeat) -> Vec<AxisConfig> {
    let mut axis = axis_in(mode);
    if heartbeat == HostHeartbeat::Off {
        axis.drive.host_heartbeat_ms = 0;
    }
    vec![axis]
}

pub fn config(heartbeat: HostHeartbeat) -> Cia402Config {
    let mut config = Cia402Config::default();
    if heartbeat == HostHeartbeat::Off {
        config.network.host_heartbeat = None;
    }
    config
}

pub fn open(scenario: Scenario, mode: OperatingMode, heartbeat: HostHeartbeat) -> Fixture {
    let adapter = ecan_host::AdapterConfig::new(1).with_cycle(Duration::from_millis(2));
    Fixture::open_with(scenario, adapter, table(mode, heartbeat), config(heartbeat))
}

/// An axis that moves at [`SPEED`].
pub fn at_speed_with(fixture: Fixture, mode: OperatingMode) -> Fixture {
    let mut fixture = fixture.started();
    accelerate(&mut fixture, mode);
    fixture
}

pub fn accelerate(fixture: &mut Fixture, mode: OperatingMode) {
    let far = fixture.axis(0).actual().unwrap() + 100_000_000;
    for cycle in 1..=2_000 {
        let target = match mode {
            OperatingMode::CyclicVelocity => Some((cycle * 20_000).min(SPEED as i32)),
            OperatingMode::CyclicTorque => Some(300),
            OperatingMode::ProfileVelocity => Some(SPEED as i32),
            OperatingMode::ProfilePosition => Some(far),
            _ => None,
        };
        if let Some(target) = target {
            fixture.axis_mut(0).set_target(target).unwrap();
        }
        fixture.step();
        if velocity(fixture) > 0.98 * SPEED {
            break;
        }
    }
    if mode == OperatingMode::CyclicTorque {
        // Balances friction: 100,000 of 4,000,000 increments/s² at 3000 thousandths.
        fixture.axis_mut(0).set_target(75).unwrap();
    }
    fixture.steps(20);
    let velocity = velocity(fixture);
    assert!((velocity - SPEED).abs() < 0.1 * SPEED, "{mode}: {velocity}/s");
}

pub fn at_speed(mode: OperatingMode, heartbeat: HostHeartbeat) -> Fixture {
    at_speed_with(open(drives(|_| {}), mode, heartbeat), mode)
}

pub fn velocity(fixture: &Fixture) -> f64 {
    fixture.drive(0, |drive| drive.velocity())
}

pub fn state(fixture: &Fixture) -> DriveState {
    fixture.drive(0, |drive| drive.state())
}

pub fn now_ms(fixture: &Fixture) -> f64 {
    fixture.now_ns() as f64 / 1e6
}

/// The next owner of the drives, on the same Port.
pub fn replace_owner(fixture: &mut Fixture, mode: OperatingMode, heartbeat: HostHeartbeat) {
    let new = Cia402::new(&fixture.port, table(mode, heartbeat), config(heartbeat));
    fixture.cia402 = new.unwrap_or_else(|error| panic!("{error}"));
}

pub fn silence(fixture: &Fixture, for_ms: u32) {
    fixture.inject(Fault::NodeSilent { node: "drive 0.0/1".into(), for_ms });
}

/// Cycles until frames of the host reach the drive again.
pub fn until_reached(fixture: &mut Fixture) {
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
pub struct Sample {
    /// Since the start of the trace.
    pub ms: f64,
    pub state: DriveState,
    pub velocity: f64,
}

/// State and velocity of the drive in each cycle, until it is at rest and 100 ms longer.
pub struct Trace(pub Vec<Sample>);

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
    pub fn of(fixture: &mut Fixture) -> Self {
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

    pub fn rest_ms(&self) -> Option<f64> {
        self.0.iter().find(|sample| sample.velocity.abs() < REST).map(|sample| sample.ms)
    }

    pub fn until_rest(&self) -> impl Iterator<Item = &Sample> {
        self.0.iter().take_while(|sample| sample.velocity.abs() >= REST)
    }

    /// The motor is at rest within `reaction_ms` and the time of the deceleration.
    pub fn assert_rest(&self, reaction_ms: f64, deceleration: f64) -> &Self {
        let from = self.0.first().unwrap().velocity.abs();
        // The ramp of the position controller ends slowly.
        let within = reaction_ms + 1_100.0 * from / deceleration + 20.0;
        let is_in_time = self.rest_ms().is_some_and(|rest| rest <= within);
        assert!(is_in_time, "at rest within {within:.0} ms: {self}");
        self
    }

    /// Nothing switched the power off before the motor was at rest.
    pub fn assert_no_coasting(&self) -> &Self {
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
    pub fn assert_not_enabled_before_rest(&self) -> &Self {
        let is_enabled = |sample: &&Sample| sample.state == DriveState::OperationEnabled;
        let again = self.until_rest().skip_while(is_enabled).find(is_enabled);
        assert!(again.is_none(), "enabled again {again:?}: {self}");
        self
    }

    /// The velocity falls at the deceleration of the quick stop, from its first change to rest.
    pub fn assert_quick_deceleration(&self) -> &Self {
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
pub fn assert_stays_stopped(fixture: &mut Fixture) {
    fixture.steps(500);
    let (state, velocity) = (state(fixture), velocity(fixture));
    assert_ne!(state, DriveState::OperationEnabled, "{:?}", fixture.axis(0).progress());
    assert!(velocity.abs() < REST, "{velocity}/s in {state}");
}

/// The axis can be used again.
pub fn assert_runs_again(fixture: &mut Fixture) {
    fixture.axis_mut(0).enable().unwrap();
    fixture.until(2_000, |cia402| cia402.axis(0).unwrap().is_running());
    assert_eq!(state(fixture), DriveState::OperationEnabled);
}
