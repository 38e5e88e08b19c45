//! Options for master, gateways and channels.

use std::time::Duration;

use clap::Args;
use ecan_host::AdapterConfig;
use ecan_mcan_port::ChannelConfig;
use ecan_sim::{Backend, BackendError};

use crate::backend::{self, SimulationDefaults};

/// Options of the programs that send plain CAN frames.
#[derive(Debug, Args)]
pub struct GatewayArguments {
    /// EtherCAT master library: a path, or `sim`, `sim:NAME`, `sim:FILE.toml` for the simulator
    /// [default: the environment variable ECAN_ECRT, else the installed libethercat]
    #[arg(long, value_name = "SETTING")]
    pub ecrt: Option<String>,
    /// Index of the EtherCAT master
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub master: u32,
    /// Number of gateways, from position 0
    #[arg(long, value_name = "N", default_value_t = 1,
          value_parser = clap::value_parser!(u16).range(1..=64))]
    pub slaves: u16,
    /// PDO size per direction, in chunks of 128 bytes
    #[arg(long, value_name = "N", default_value_t = 3)]
    pub pdo_n: u8,
    /// Allow PDOs above 1486 bytes: the master must split them into datagrams
    #[arg(long)]
    pub large_pdos: bool,
    /// Nominal bit rate, bit/s
    #[arg(long, value_name = "BITRATE", default_value_t = 1_000_000)]
    pub bitrate: u32,
    /// Use CAN FD with this data bit rate, bit/s
    #[arg(long, value_name = "DATA_BITRATE")]
    pub fd: Option<u32>,
    /// Print the plan with its warnings and exit, without a bus
    #[arg(long)]
    pub plan: bool,
    /// Seed of the random numbers of a simulation
    #[arg(long, value_name = "SEED")]
    pub seed: Option<u64>,
    /// Run a simulation in wall-clock time instead of at full speed
    #[arg(long)]
    pub real_time: bool,
}

impl GatewayArguments {
    /// Configuration of the Adapter with this cycle.
    pub fn adapter(&self, cycle_us: u32) -> AdapterConfig {
        let mut adapter = AdapterConfig::new(self.slaves)
            .with_multiplier(self.pdo_n)
            .with_cycle(Duration::from_micros(cycle_us.into()));
        adapter.master_index = self.master;
        adapter.allow_large_pdos = self.large_pdos;
        adapter
    }

    /// Configuration of a CAN channel.
    pub fn channel(&self) -> ChannelConfig {
        match self.fd {
            Some(data_bitrate) => ChannelConfig::fd(self.bitrate, data_bitrate),
            None => ChannelConfig::classic(self.bitrate),
        }
    }

    /// Opens the library; a plain `sim` selects this scenario, with the gateways of the Adapter.
    ///
    /// # Errors
    /// The library or the scenario cannot be opened.
    pub fn open_backend(
        &self,
        scenario: &'static str,
        adapter: &AdapterConfig,
    ) -> Result<Backend, BackendError> {
        let last_position = adapter.slaves.iter().map(|slave| slave.position).max();
        let defaults = SimulationDefaults {
            scenario,
            slaves: last_position.map_or(1, |position| usize::from(position) + 1),
            seed: self.seed,
            real_time: self.real_time,
            large_pdos: adapter.allow_large_pdos,
        };
        backend::open(self.ecrt.as_deref(), defaults)
    }
}
