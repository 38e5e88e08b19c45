//! Gateways and frames of a loop, from the options of its program for master, gateways and channels.

use std::error::Error;
use std::path::Path;

use clap::Args;
use ecan_can_io::recording::LoggedFrame;
use ecan_host::AdapterConfig;
use ecan_mcan_port::{ChannelConfig, GatewayConfig, PortConfig};
use ecan_protocol::can::CanId;
use ecan_protocol::text::Printable;
use ecan_tool_support::command_line::options::parse_bit_rate;
use ecan_tool_support::{print_error_line, print_line};

use crate::frame_source::{Channels, RecordedFrame, Source, Target};
use crate::log_file;
use crate::program::MasterArguments;

/// Gaps of a recording that are reported, ns.
const LONG_GAP_NS: u64 = 60_000_000_000;

/// Configuration of the gateways, and the channels that carry frames.
#[derive(Debug, Clone)]
pub struct LoopSetup {
    /// Master, slaves and cycle.
    pub adapter: AdapterConfig,
    /// Channels of the gateways.
    pub port: PortConfig,
    channels: Channels,
    /// Remedy for a CAN FD frame on a classic channel.
    fd_remedy: String,
}

impl LoopSetup {
    /// Reads a configuration file (`ecan config example` prints one).
    ///
    /// # Errors
    /// The file is faulty, or no gateway in it has the selected channel.
    pub fn from_file(path: &Path, channels: Channels) -> Result<Self, Box<dyn Error>> {
        let file = ecan_lite::config::load(path)?;
        if let Channels::One(channel) = channels
            && channels.targets(&file.port).is_empty()
        {
            return Err(format!("{} has no channel {channel}", Printable(path.display())).into());
        }
        let fd_remedy = format!("set data_bitrate in {}", Printable(path.display()));
        Ok(Self { adapter: file.adapter, port: file.port, channels, fd_remedy })
    }

    /// Uses the options; all gateways are equal.
    pub fn from_arguments(arguments: &GatewayArguments, cycle_us: u32, channels: Channels) -> Self {
        let adapter = arguments.adapter(cycle_us);
        let gateway = match channels {
            Channels::One(channel) => GatewayConfig::on_channel(channel, arguments.channel()),
            Channels::All => GatewayConfig::on_all_channels(arguments.channel()),
        };
        let port = PortConfig::uniform(adapter.slaves.len(), gateway);
        let fd_remedy = "set --fd DATA_BITRATE".to_owned();
        Self { adapter, port, channels, fd_remedy }
    }

    /// A frame with a counter per channel and cycle.
    pub fn counter(&self, id: CanId, cycles: u64) -> Source {
        Source::Counter { id, targets: self.channels.targets(&self.port), cycles, done: 0 }
    }

    /// The frames of a recording. Prints its long gaps.
    ///
    /// # Errors
    /// The file cannot be read, or a frame does not fit the configured channels.
    pub fn recording(&self, path: &Path) -> Result<Source, Box<dyn Error>> {
        let name = Printable(path.display());
        let targets = self.channels.targets(&self.port);
        let assign = |logged| self.assign(logged, &targets);
        let recording = log_file::read(path)?;
        log_file::losses(path, &recording).iter().for_each(|loss| print_error_line!("{loss}"));
        let frames: Vec<_> = recording
            .frames
            .into_iter()
            .map(assign)
            .collect::<Result<_, _>>()
            .map_err(|reason| format!("{name}, {reason}"))?;
        for pair in frames.windows(2) {
            let (one, next) = (&pair[0].logged, &pair[1].logged);
            let gap = next.time_ns.saturating_sub(one.time_ns);
            if gap > LONG_GAP_NS {
                print_line!(
                    "{name}, line {}: {} s without a frame",
                    next.line,
                    gap / 1_000_000_000
                );
            }
        }
        Ok(Source::Recording { frames, done: 0 })
    }

    fn assign(&self, logged: LoggedFrame, targets: &[Target]) -> Result<RecordedFrame, String> {
        let (line, interface) = (logged.line, &logged.interface);
        let gateways = self.port.gateways.len();
        let (slave, channel) = self.channels.target_of(interface, targets, gateways);
        match targets.iter().find(|target| (target.slave, target.channel) == (slave, channel)) {
            Some(target) if target.is_fd || !logged.frame.as_ref().is_fd() => {
                Ok(RecordedFrame { target: *target, logged })
            }
            Some(_) => Err(format!(
                "line {line}: CAN FD frame, but slave {slave} channel {channel} is classic; {}",
                self.fd_remedy
            )),
            None => Err(format!(
                "line {line}: {interface} is slave {slave} channel {channel}, which is not configured"
            )),
        }
    }
}

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
    /// PDO size per direction, in chunks of 128 bytes [default: 3, with --fd 8]
    #[arg(long, value_name = "N")]
    pub pdo_n: Option<u8>,
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
        let adapter = self.master.adapter(self.slaves, self.pdo_n(), cycle_us);
        AdapterConfig { allow_large_pdos: self.large_pdos, ..adapter }
    }

    /// PDO size of the options, else that of the channel's kind of CAN.
    pub fn pdo_n(&self) -> u8 {
        let gateway = GatewayConfig::on_channel(0, self.channel());
        self.pdo_n.unwrap_or_else(|| gateway.default_multiplier())
    }

    /// Configuration of a CAN channel.
    pub fn channel(&self) -> ChannelConfig {
        match self.fd {
            Some(data_bitrate) => ChannelConfig::fd(self.bitrate, data_bitrate),
            None => ChannelConfig::classic(self.bitrate),
        }
    }
}
