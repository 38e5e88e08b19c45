//! The `--ecrt` option: the real EtherCAT master or the simulated one.

use ecan_sim::{Backend, BackendError, ClockKind, EcrtSetting, SimOptions};

/// Simulation that a program uses by default.
#[derive(Debug, Clone, Copy, Default)]
pub struct SimulationDefaults {
    /// Built-in scenario of a plain `sim`.
    pub scenario: &'static str,
    /// Number of gateways.
    pub slaves: usize,
    /// Seed of the random numbers.
    pub seed: Option<u64>,
    /// Run in wall-clock time instead of at full speed.
    pub real_time: bool,
    /// The configuration has PDOs that a master must split into datagrams.
    pub large_pdos: bool,
}

/// Opens the library that `--ecrt`, the environment or the default selects, and prints the banner of
/// a simulated run.
///
/// # Errors
/// The library or the scenario cannot be opened.
pub fn open(setting: Option<&str>, defaults: SimulationDefaults) -> Result<Backend, BackendError> {
    let setting = EcrtSetting::resolve(setting)?;
    let clock = if defaults.real_time { ClockKind::Real } else { ClockKind::Stepped };
    let options = SimOptions {
        suggested: Some(defaults.scenario.into()),
        clock: Some(clock),
        seed: defaults.seed,
        slaves: Some(defaults.slaves),
        carries_large_pdos: defaults.large_pdos.then_some(true),
        bridges: Some(ecan_sim_bridge::make),
    };
    let backend = ecan_sim::open(&setting, &options)?;
    if let Some(simulation) = &backend.simulation {
        println!("{}", simulation.banner());
    }
    Ok(backend)
}
