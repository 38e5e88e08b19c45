//! What all programs share: options of the master and of the cycle, waiting for gateways, progress, and the end with one readable
//! message and a status for scripts.

use std::error::Error;
use std::process::ExitCode;
use std::time::Duration;

use clap::Args;
use ecan_host::AdapterConfig;
use ecan_lite::EcrtOptions;
use ecan_lite::config::ConfigFileError;
use ecan_mcan_port::{Port, PortError};
use ecan_sim::{Backend, BackendError, ClockKind, EcrtSetting, SimOptions};
use ecan_tool_support::command_line::log_file::LogFileError;
use ecan_tool_support::command_line::options::LogArguments;
use ecan_tool_support::command_line::screen::Stream;
use ecan_tool_support::plot::PlotError;
use ecan_tool_support::{print_error_line, print_line};
use indicatif::{ProgressBar, ProgressStyle};

use crate::interrupt::Interrupt;
use crate::real_time::RealTimeArguments;

/// Exit statuses, with the numbers of `ecan`.
pub const EXIT_STATUS: &str = "\
Exit status:
  0  success
  1  the run failed
  2  invalid arguments
  3  the EtherCAT master library cannot be loaded
  6  file or scenario cannot be read, written or parsed";

/// Success, failure without a message (already printed), or failure with one.
pub fn report_exit(program: &str, result: Result<bool, Box<dyn Error>>) -> ExitCode {
    match result {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(error) => {
            print_error_line!("{program}: {error}");
            ExitCode::from(status(&*error))
        }
    }
}

fn status(error: &(dyn Error + 'static)) -> u8 {
    match error.downcast_ref::<BackendError>() {
        Some(error) if error.is_scenario() => 6,
        Some(_) => 3,
        None => {
            let is_file = error.is::<ConfigFileError>()
                || error.is::<LogFileError>()
                || error.is::<PlotError>();
            if is_file { 6 } else { 1 }
        }
    }
}

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
    /// prints the banner of a simulated run. A plain `sim` has what the program configures, with this
    /// built-in scenario if that are gateways only.
    ///
    /// # Errors
    /// The library or the scenario cannot be opened.
    pub fn open(&self, scenario: &str, fitting: EcrtOptions) -> Result<Backend, BackendError> {
        self.log.start();
        let setting = EcrtSetting::resolve(self.ecrt.as_deref())?;
        let clock = if self.real_time { ClockKind::Real } else { ClockKind::Stepped };
        let options = SimOptions {
            suggested: Some(scenario.into()),
            clock: Some(clock),
            seed: self.seed,
            bridges: Some(ecan_sim::bridge::make),
            ..fitting.simulation
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

/// Applies the cycle timing, and measures the cycles if the user asked for real time.
pub fn run_options(port: &mut Port, thread: &RealTimeArguments, real_time: bool) {
    thread.set_timing(port.adapter_mut());
    if real_time || thread.is_given() {
        port.adapter_mut().measure_cycles();
    }
}

/// Waits until all gateways are ready. Prints a message and returns false if the user stopped the
/// program.
///
/// # Errors
/// A gateway did not become ready in time; the error names it and the reason.
pub fn wait_ready(port: &mut Port, interrupt: &Interrupt) -> Result<bool, PortError> {
    let interrupt = interrupt.clone();
    port.adapter_mut().stop_waiting_when(Some(Box::new(move || interrupt.is_set())));
    let ready = port.wait_ready();
    port.adapter_mut().stop_waiting_when(None);
    if matches!(ready, Err(PortError::Adapter(ecan_host::Error::Stopped))) {
        print_line!("stopped by the user");
        return Ok(false);
    }
    ready.map(|()| true)
}

/// Time without a frame after which none is pending, ns.
pub const IDLE_TIMEOUT_NS: u64 = 200_000_000;
/// Time without an accepted or received frame after which a program ends, ns.
pub const STALL_TIMEOUT_NS: u64 = 10_000_000_000;

/// Steps below which a bar would only flicker.
const LONG: u64 = 500;

/// A bar on standard error, hidden for short runs and if standard error is not a terminal.
pub fn bar(total: u64) -> ProgressBar {
    if total < LONG || !Stream::Error.is_terminal() {
        return ProgressBar::hidden();
    }
    let bar = ProgressBar::new(total);
    if let Ok(style) = ProgressStyle::with_template("{bar:40} {pos}/{len}  {eta} left") {
        bar.set_style(style);
    }
    bar
}
