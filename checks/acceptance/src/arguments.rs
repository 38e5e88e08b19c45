use std::path::PathBuf;

use clap::Parser;

/// Run the acceptance list of the ECAN-Lite host SDK on an EtherCAT master.
///
/// Exit status: 0 all steps passed, or were skipped for a stated reason; 1 a step failed, or the run
/// was interrupted; 2 invalid arguments.
#[derive(Debug, Clone, Parser)]
#[command(name = "ecan-acceptance", version)]
pub struct Arguments {
    /// EtherCAT library: a path, or sim
    #[arg(long, value_name = "PATH", required_unless_present = "list")]
    pub library: Option<String>,
    /// Path of IgH's tool ethercat
    #[arg(long, value_name = "PATH")]
    pub ethercat: Option<PathBuf>,
    /// Network interface of the simulated gateways: the other end of the master's cable
    #[arg(long, value_name = "IF")]
    pub interface: Option<String>,
    /// Use the gateways that are connected to the master; no simulated ones
    #[arg(long, conflicts_with = "interface")]
    pub device: bool,
    /// Number of gateways: connected ones with --device, else the most to simulate
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = clap::value_parser!(u16).range(1..=16))]
    pub gateways: u16,
    /// With --device: a node on each channel returns every frame
    #[arg(long, requires = "device")]
    pub echo_nodes: bool,
    /// With --device: shell command that switches the supply of the gateways off and on again
    #[arg(long, value_name = "COMMAND", requires = "device")]
    pub power_cycle: Option<String>,
    /// With --device: steps may replace and erase the saved configuration of the first gateway
    #[arg(long, requires = "device")]
    pub write_flash: bool,
    /// With a simulated library: pace and side activities of IgH's master
    #[arg(long)]
    pub like_igh: bool,
    /// With library sim: run the steps with each alternative of `ecan-sim variants` and write
    /// variants.md; a step may end with an error that names the assumption
    #[arg(long)]
    pub each_variant: bool,
    /// With --each-variant: only this switch (repeatable)
    #[arg(long, value_name = "KEY", requires = "each_variant")]
    pub switch: Vec<String>,
    /// Index of the EtherCAT master
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub master: u16,
    /// Short list: fewer repetitions, and without the long steps
    #[arg(long)]
    pub quick: bool,
    /// Directory with programs: ecan, ecan-sim, examples, igh_* (repeatable)
    #[arg(long, value_name = "DIR", required_unless_present = "list")]
    pub bin: Vec<PathBuf>,
    /// Directory with scripts of the SDK
    #[arg(long, value_name = "DIR", default_value = "scripts")]
    pub scripts: PathBuf,
    /// Directory for the report and the outputs of all programs
    #[arg(long, value_name = "DIR", default_value = "acceptance-report")]
    pub report: PathBuf,
    /// EtherCAT cycle of the programs, in us
    #[arg(long, value_name = "US", default_value_t = 4000, value_parser = clap::value_parser!(u32).range(250..=100_000))]
    pub cycle_us: u32,
    /// Run the programs and simulated gateways with this real-time priority
    #[arg(long, value_name = "PRIORITY", value_parser = clap::value_parser!(u8).range(1..=99))]
    pub rt_priority: Option<u8>,
    /// Factor of all time limits, for slow machines
    #[arg(long, value_name = "FACTOR", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=100))]
    pub patience: u32,
    /// Number of starts in a row in the restart steps [default: 100, quick: 5]
    #[arg(long, value_name = "N")]
    pub starts: Option<u32>,
    /// Number of power cycles and of link losses in a row [default: 50, quick: 2]
    #[arg(long, value_name = "N")]
    pub outages: Option<u32>,
    /// Seed of the random pauses
    #[arg(long, value_name = "SEED", default_value_t = 1)]
    pub seed: u64,
    /// Run only steps whose GROUP/NAME contains this text (repeatable)
    #[arg(long, value_name = "TEXT")]
    pub only: Vec<String>,
    /// Skip steps whose GROUP/NAME contains this text (repeatable)
    #[arg(long, value_name = "TEXT")]
    pub except: Vec<String>,
    /// Print the list of steps and exit
    #[arg(long)]
    pub list: bool,
}
