//! The options that make a program's thread keep its cycle (manual 13.9), and what is said about it.

use clap::Args;
use ecan_host::{
    Adapter, CycleStatistics, CycleTiming, MAX_SPIN_NS, Need, OverrunPolicy, RealTimeConfig,
    RealTimeError,
};

/// Stack that is touched in advance with `--lock-memory`, in bytes.
const STACK_BYTES: usize = 256 * 1024;

/// Options for a thread that is to be in time.
#[derive(Debug, Clone, Args)]
#[command(next_help_heading = "Real time")]
pub struct ThreadArguments {
    /// Run under SCHED_FIFO with this priority, 1 to 99.
    #[arg(long, value_name = "PRIORITY", value_parser = clap::value_parser!(u8).range(1..=99))]
    rt_priority: Option<u8>,
    /// Run on this CPU only; several with commas between.
    #[arg(long, value_name = "CPU", value_delimiter = ',')]
    cpu: Option<Vec<usize>>,
    /// Keep all memory in RAM.
    #[arg(long)]
    lock_memory: bool,
    /// Give up where the system does not grant what these options ask for.
    #[arg(long)]
    rt_required: bool,
}

impl ThreadArguments {
    /// What is asked of the system.
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

/// Options for the thread of the cycle.
#[derive(Debug, Clone, Args)]
#[command(next_help_heading = "Real time")]
pub struct RealTimeArguments {
    #[command(flatten)]
    thread: ThreadArguments,
    /// Keep the processors out of sleep states that take longer than so many microseconds to leave.
    #[arg(long, value_name = "US")]
    cpu_latency_us: Option<u32>,
    /// Look at the clock for the last so many microseconds before each cycle instead of sleeping.
    #[arg(long, value_name = "US", default_value_t = 0, hide_default_value = true,
          value_parser = clap::value_parser!(u64).range(..=MAX_SPIN_NS / 1000))]
    spin_us: u64,
}

impl RealTimeArguments {
    /// Whether any of them is given.
    pub fn is_given(&self) -> bool {
        self.settings() != RealTimeConfig::default()
    }

    fn settings(&self) -> RealTimeConfig {
        RealTimeConfig {
            wake_up_latency_us: self.cpu_latency_us,
            timing: CycleTiming { spin_ns: self.spin_us * 1000, overrun: OverrunPolicy::Skip },
            ..self.thread.settings()
        }
    }

    /// Applies them to this thread and says, a line each, what was granted.
    ///
    /// To be called when the threads that shall not inherit them run, and before the cycle does.
    ///
    /// # Errors
    /// What `--rt-required` asks for was not granted.
    pub fn apply(&self, mut say: impl FnMut(&str)) -> Result<(), RealTimeError> {
        let report = self.settings().apply()?;
        for outcome in &report.outcomes {
            say(&outcome.to_string());
        }
        if !report.is_complete() {
            say("going on without it");
        }
        Ok(())
    }

    /// Makes the Adapter wait for its cycles as asked for.
    pub fn set_timing(&self, adapter: &mut Adapter) {
        adapter.set_cycle_timing(self.settings().timing);
    }
}

/// Prints how the cycle was kept.
pub fn print_statistics(adapter: &Adapter, statistics: &CycleStatistics) {
    println!("\n{statistics}");
    if !adapter.clock().is_free_running() {
        println!("these are simulated times: --real-time measures the machine");
    }
}
