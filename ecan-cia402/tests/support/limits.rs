//! Axes at their limits, and the motor of an axis as its drive moves it.

use std::time::Duration;

use ecan_canopen::SyncConfig;
use ecan_cia402::{AxisConfig, Cia402Config};
use ecan_host::AdapterConfig;
use ecan_sim::TraceEvent;

use crate::axes::{Fixture, axes, scenario};

pub const STEP: u32 = 1_000;
pub const MS: u64 = 1_000_000;

pub fn adapter(cycle_us: u64) -> AdapterConfig {
    AdapterConfig::new(1).with_cycle(Duration::from_micros(cycle_us))
}

/// Axes that move at their step limit.
pub fn at_limit(count: usize) -> Vec<AxisConfig> {
    let table = axes(count).into_iter();
    let at_limit =
        |axis: AxisConfig| AxisConfig { ramp: STEP / 10, ..axis.with_target_step(STEP as i32) };
    table.map(at_limit).collect()
}

pub fn config(motion_div: u32, every_cycles: u32) -> Cia402Config {
    let sync = SyncConfig { every_cycles, ..SyncConfig::default() };
    Cia402Config { motion_div, sync, ..Cia402Config::default() }
}

pub fn fixture(cycle_us: u64, axes: Vec<AxisConfig>, config: Cia402Config) -> Fixture {
    let traced = scenario(1, |drive| drive.trace = 100_000);
    Fixture::open_with(traced, adapter(cycle_us), axes, config)
}

/// The motor of an axis since a time.
pub struct MotorWatch {
    axis: usize,
    since_ns: u64,
}

impl MotorWatch {
    pub fn new(fixture: &Fixture, axis: usize) -> Self {
        Self { axis, since_ns: fixture.now_ns() }
    }

    /// Velocity at the end of each controller period, in increments per second.
    pub fn velocities(&self, fixture: &Fixture) -> Vec<f64> {
        let new = |drive: &ecan_sim::Drive| {
            let records = drive.trace().iter().filter(|record| record.time_ns >= self.since_ns);
            let velocity = |event| match event {
                TraceEvent::Motion(sample) => Some(sample.velocity),
                _ => None,
            };
            records.filter_map(|record| velocity(record.event)).collect()
        };
        fixture.drive(self.axis, new)
    }

    /// Most targets that took effect within less than a time.
    pub fn most_targets(&self, fixture: &Fixture, within_ns: u64) -> usize {
        let times: Vec<u64> =
            fixture.history(self.axis).iter().map(|record| record.time_ns).collect();
        let new = times.iter().enumerate().filter(|(_, time)| **time >= self.since_ns);
        let count = |(n, from): (usize, &u64)| {
            times.iter().skip(n).take_while(|time| **time < from + within_ns).count()
        };
        new.map(count).max().unwrap_or(0)
    }

    pub fn range(&self, fixture: &Fixture) -> (f64, f64) {
        let velocities = self.velocities(fixture);
        assert!(!velocities.is_empty());
        let fold = |(low, high): (f64, f64), v: &f64| (low.min(*v), high.max(*v));
        velocities.iter().fold((f64::MAX, f64::MIN), fold)
    }
}

/// Pseudo-random numbers (xorshift); the seed is not 0.
pub struct Random(pub u64);

impl Random {
    pub fn below(&mut self, bound: u64) -> u64 {
        let Self(state) = self;
        *state ^= *state << 13;
        *state ^= *state >> 7;
        *state ^= *state << 17;
        state.wrapping_mul(0x2545_F491_4F6C_DD1D) % bound
    }
}

pub fn largest_step(fixture: &Fixture, axis: usize) -> u32 {
    fixture.drive(axis, |drive| drive.targets().sums().largest_step)
}
