//! Options of the EtherCAT master: the real one or the simulated one.

use std::time::Duration;

use clap::Args;
use ecan_host::AdapterConfig;
use ecan_sim::{Backend, BackendError, ClockKind, EcrtSetting, SimOptions};
use ecan_tool_support::command_line::options::LogArguments;
use ecan_tool_support::print_error_line;
use ecan_tool_support::print_line;

/// Options of all programs.
#[derive(Debug, Args)]
pub struct MasterArguments {
    /// EtherCAT master library: a path, or `sim`, `sim:NAME`, `sim:FILE.toml` for the simulator
    /// [default: the environment variable ECAN_ECRT, else the installed libethercat]
    #[arg(long, value_name = "SETTING")]
    ecrt: Option<String>,
    /// Index of the EtherCAT master
    #[arg(long, value_name = "N", default_value_t = 0)]
    master: u32,
    /// Seed of the random numbers of a simulation
    #[arg(long, value_name = "SEED")]
    seed: Option<u64>,
    /// Run a simulation in wall-clock time instead of at full speed
    #[arg(long)]
    pub real_time: bool,
    #[command(flatten)]
    log: LogArguments,
}

impl MasterArguments {
    /// Configuration of the Adapter for gateways from position 0.
    pub fn adapter(&self, slaves: u16, pdo_n: u8, cycle_us: u32) -> AdapterConfig {
        let cycle = Duration::from_micros(cycle_us.into());
        let adapter = AdapterConfig::new(slaves).with_multiplier(pdo_n).with_cycle(cycle);
        AdapterConfig { master_index: self.master, ..adapter }
    }

    /// Starts the log, opens the library that `--ecrt`, the environment or the default selects, and
    /// prints the banner of a simulated run. A plain `sim` selects this built-in scenario, with the
    /// gateways of the Adapter.
    ///
    /// # Errors
    /// The library or the scenario cannot be opened.
    pub fn open(&self, scenario: &str, adapter: &AdapterConfig) -> Result<Backend, BackendError> {
        self.log.start();
        let setting = EcrtSetting::resolve(self.ecrt.as_deref())?;
        let clock = if self.real_time { ClockKind::Real } else { ClockKind::Stepped };
        let last_position = adapter.slaves.iter().map(|slave| slave.position).max();
        let options = SimOptions {
            suggested: Some(scenario.into()),
            clock: Some(clock),
            seed: self.seed,
            slaves: last_position.map(|position| usize::from(position) + 1),
            carries_large_pdos: adapter.allow_large_pdos.then_some(true),
            bridges: Some(ecan_sim::bridge::make),
        };
        let backend = ecan_sim::open(&setting, &options)?;
        if let Some(simulation) = &backend.simulation {
            print_line!("{}", simulation.banner());
            simulation.observe_faults(|record| print_error_line!("{record}"));
        }
        if let Some(warning) = backend.ecrt.release_warning() {
            print_error_line!("{warning}");
        }
        Ok(backend)
    }
}
