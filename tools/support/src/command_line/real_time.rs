//! Real-time options of a program (manual 13.9).

use crate::print_line;
use clap::Args;
use ecan_host::{
    Adapter, CycleStatistics, CycleTiming, MAX_SPIN_NS, Need, OverrunPolicy, RealTimeConfig,
    RealTimeError,
};

/// Size of the stack to prefault with `--lock-memory`, in bytes.
const STACK_BYTES: usize = 256 * 1024;

/// Real-time options of a thread.
#[derive(Debug, Clone, Args)]
#[command(next_help_heading = "Real time")]
pub struct ThreadArguments {
    /// Run under SCHED_FIFO with this priority, 1 to 99
    #[arg(long, value_name = "PRIORITY", value_parser = clap::value_parser!(u8).range(1..=99))]
    rt_priority: Option<u8>,
    /// Run on these CPUs only, comma-separated
    #[arg(long, value_name = "CPU", value_delimiter = ',')]
    cpu: Option<Vec<usize>>,
    /// Lock all memory in RAM
    #[arg(long)]
    lock_memory: bool,
    /// Fail if the system denies a requested real-time setting
    #[arg(long)]
    rt_required: bool,
}

impl ThreadArguments {
    /// Returns the settings.
    pub fn settings(&self) -> RealTimeConfig {
        let need = if self.rt_required { Need::Required } else { Need::Optional };
        RealTimeConfig {
            priority: self.rt_priority,
            priority_need: need,
            cpus: self.cpu.clone(),
            cpus_need: need,
            lock_memory: self.lock_memory.then_some(STACK_BYTES),
            lock_memory_need: need,
            wake_up_latency_need: need,
            ..RealTimeConfig::default()
        }
    }
}

/// Real-time options of the cycle thread.
#[derive(Debug, Clone, Args)]
#[command(next_help_heading = "Real time")]
pub struct RealTimeArguments {
    #[command(flatten)]
    thread: ThreadArguments,
    /// Limit the exit latency of CPU sleep states, in us
    #[arg(long, value_name = "US")]
    cpu_latency_us: Option<u32>,
    /// Spin instead of sleeping for this time before each cycle, in us
    #[arg(long, value_name = "US", default_value_t = 0, hide_default_value = true,
          value_parser = clap::value_parser!(u64).range(..=MAX_SPIN_NS / 1000))]
    spin_us: u64,
}

impl RealTimeArguments {
    /// Returns whether any option is given.
    pub fn is_given(&self) -> bool {
        self.settings() != RealTimeConfig::default()
    }

    /// Spin before each cycle, as set by the options.
    pub fn timing(&self) -> CycleTiming {
        CycleTiming { spin_ns: self.spin_us * 1000, overrun: OverrunPolicy::Skip }
    }

    fn settings(&self) -> RealTimeConfig {
        RealTimeConfig {
            wake_up_latency_us: self.cpu_latency_us,
            timing: self.timing(),
            ..self.thread.settings()
        }
    }

    /// Applies the settings to this thread and reports each result as a line.
    ///
    /// Call it after starting threads that must not inherit the settings, and before the cycle
    /// starts.
    ///
    /// # Errors
    /// A setting was denied and `--rt-required` is given.
    pub fn apply(&self, mut report_line: impl FnMut(&str)) -> Result<(), RealTimeError> {
        let report = self.settings().apply()?;
        for outcome in &report.outcomes {
            report_line(&outcome.to_string());
        }
        if !report.is_complete() {
            report_line("continuing without the denied settings");
        }
        Ok(())
    }

    /// Sets the cycle timing of the Adapter.
    pub fn set_timing(&self, adapter: &mut Adapter) {
        adapter.set_cycle_timing(self.timing());
    }
}

/// Prints the cycle statistics.
pub fn print_statistics(adapter: &Adapter, statistics: &CycleStatistics) {
    print_line!("\n{statistics}");
    if !adapter.clock().is_free_running() {
        print_line!("simulated times; use --real-time to measure this machine");
    }
}
