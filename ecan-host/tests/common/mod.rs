//! Simulated buses in stepped time for the Adapter's tests.
#![allow(dead_code, missing_docs)]

use std::time::Duration;

use ecan_host::{Adapter, AdapterConfig, Ecrt, Error, StartupPlan, StartupStep};
use ecan_protocol::image::PdoProfile;
use ecan_protocol::mapping::Direction;
use ecan_sim::{ClockKind, Scenario, SimOptions, Simulation};

pub fn simulated(scenario: Scenario) -> (Ecrt, Simulation) {
    let options = SimOptions { clock: Some(ClockKind::Stepped), ..SimOptions::default() };
    let backend = ecan_sim::open_scenario(scenario, &options).expect("scenario");
    (backend.ecrt, backend.simulation.expect("simulated"))
}

pub fn open(scenario: Scenario, config: AdapterConfig) -> Result<Adapter, Error> {
    Adapter::open(&simulated(scenario).0, config, StartupPlan::default())
}

/// Runs cycles without touching the images.
pub fn run(adapter: &mut Adapter, cycles: usize) {
    for _ in 0..cycles {
        adapter.wait_next_cycle();
        adapter.receive().unwrap();
        adapter.send().unwrap();
    }
}

/// The steps that give the gateway a profile for N = 3, as an application without the Port does
/// (manual 15.5.3).
pub fn raw_config() -> (AdapterConfig, PdoProfile) {
    (raw_config_of(1, 3), PdoProfile { multiplier: 3, ..PdoProfile::default() })
}

/// The same for so many gateways with this N.
pub fn raw_config_of(gateways: u16, multiplier: u8) -> AdapterConfig {
    let mut config = AdapterConfig::new(gateways)
        .with_multiplier(multiplier)
        .with_cycle(Duration::from_millis(1));
    let profile = PdoProfile { multiplier, ..PdoProfile::default() };
    for slave in 0..gateways.into() {
        for direction in [Direction::TxPdo, Direction::RxPdo] {
            add_profile(&mut config, slave, direction, &profile);
            config
                .add_startup(slave, StartupStep::expect(direction.profile_object(), 2, 0))
                .unwrap();
        }
    }
    config
}

/// Adds the writes of a profile, and its apply command.
pub fn add_profile(
    config: &mut AdapterConfig,
    slave: usize,
    direction: Direction,
    profile: &PdoProfile,
) {
    for write in profile.writes(direction).chain([PdoProfile::apply_write(direction)]) {
        config.add_startup(slave, write).unwrap();
    }
}
