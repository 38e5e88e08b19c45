//! The `--ecrt` option: the real EtherCAT master or the simulated one.

use ecan_sim::{Backend, BackendError, ClockKind, EcrtSetting, SimOptions};

/// How a program wants its simulation, should one be asked for.
#[derive(Debug, Clone, Copy)]
pub struct SimulationDefaults {
    /// Built-in scenario for a plain `sim`.
    pub scenario: &'static str,
    /// Number of gateways.
    pub slaves: usize,
    /// Seed of everything random in the simulation.
    pub seed: Option<u64>,
    /// Run in wall-clock time instead of as fast as the machine goes.
    pub real_time: bool,
    /// The program asks for PDOs that only a segmenting master carries.
    pub large_pdos: bool,
}

/// Opens the library that `--ecrt`, the environment or the default names, and prints the banner
/// of a simulated run.
///
/// # Errors
/// Why there is no library, in words.
pub fn open(setting: Option<&str>, wishes: SimulationDefaults) -> Result<Backend, BackendError> {
    let setting = EcrtSetting::resolve(setting)?;
    let clock = if wishes.real_time { ClockKind::Real } else { ClockKind::Stepped };
    let options = SimOptions {
        suggested: Some(wishes.scenario.into()),
        clock: Some(clock),
        seed: wishes.seed,
        slaves: Some(wishes.slaves),
        carries_large_pdos: wishes.large_pdos.then_some(true),
        bridges: Some(ecan_sim_bridge::make),
    };
    let backend = ecan_sim::open(&setting, &options)?;
    if let Some(simulation) = &backend.simulation {
        println!("{}", simulation.banner());
    }
    Ok(backend)
}
