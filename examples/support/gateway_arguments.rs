//! Options for master, gateways and channels.

use clap::Args;
use ecan_host::AdapterConfig;
use ecan_mcan_port::ChannelConfig;
use ecan_tool_support::command_line::options::parse_bit_rate;

use crate::backend::MasterArguments;

/// Options of the programs that send plain CAN frames.
#[derive(Debug, Args)]
pub struct GatewayArguments {
    /// Options of the master
    #[command(flatten)]
    pub master: MasterArguments,
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
    /// Nominal bit rate in bit/s, or 500k, 1M
    #[arg(long, value_name = "BITRATE", default_value = "1M", value_parser = parse_bit_rate)]
    pub bitrate: u32,
    /// Use CAN FD with this data bit rate in bit/s, or 2M
    #[arg(long, value_name = "DATA_BITRATE", value_parser = parse_bit_rate)]
    pub fd: Option<u32>,
    /// Print the plan with its warnings and exit, without a bus
    #[arg(long)]
    pub plan: bool,
}

impl GatewayArguments {
    /// Configuration of the Adapter with this cycle.
    pub fn adapter(&self, cycle_us: u32) -> AdapterConfig {
        let adapter = self.master.adapter(self.slaves, self.pdo_n, cycle_us);
        AdapterConfig { allow_large_pdos: self.large_pdos, ..adapter }
    }

    /// Configuration of a CAN channel.
    pub fn channel(&self) -> ChannelConfig {
        match self.fd {
            Some(data_bitrate) => ChannelConfig::fd(self.bitrate, data_bitrate),
            None => ChannelConfig::classic(self.bitrate),
        }
    }
}
