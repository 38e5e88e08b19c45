//! Gateway and channel options of the frame commands.

use std::time::Duration;

use std::path::PathBuf;

use clap::Args;
use ecan_host::AdapterConfig;
use ecan_mcan_port::{ChannelConfig, PortConfig};
use ecan_protocol::config::SamplePointWindow;
use ecan_tool_support::command_line::options::RealTimeArguments;
use ecan_tool_support::command_line::options::parse_bit_rate;

use crate::frames::capture::CaptureOptions;

#[derive(Clone, Debug, Args)]
pub struct FrameOptions {
    #[command(flatten)]
    pub capture: CaptureOptions,
    #[command(flatten)]
    pub gateway: GatewayOptions,
}

impl FrameOptions {
    /// The same options with another nominal bit rate, for classic CAN.
    pub fn at_bit_rate(&self, bitrate: u32) -> Self {
        let mut options = self.clone();
        options.gateway.setup.bitrate = Some(bitrate);
        options
    }
}

const OF_THE_FILE: [&str; 7] = [
    "bitrate",
    "data_bitrate",
    "sample_point",
    "data_sample_point",
    "pdo_n",
    "large_pdos",
    "cycle_us",
];

/// Options for the gateway, its channels and the cycle thread.
#[derive(Clone, Debug, Args)]
pub struct GatewayOptions {
    #[command(
        flatten,
        next_help_heading = "Gateway (settings stay active until a power cycle; `config save` would store them)"
    )]
    pub setup: SetupOptions,
    #[command(flatten)]
    pub real_time: RealTimeArguments,
}

/// Options for the gateway and its channels.
#[derive(Clone, Debug, Args)]
pub struct SetupOptions {
    /// Use a configuration file for all gateway settings, see `ecan config`
    #[arg(long, value_name = "FILE", conflicts_with_all = OF_THE_FILE)]
    pub config: Option<PathBuf>,
    /// Nominal bit rate in bit/s, or 500k, 1M; classic CAN without --data-bitrate [default: from the
    /// gateway; 500k in a plan]
    #[arg(long, value_name = "BITRATE", value_parser = parse_bit_rate)]
    pub bitrate: Option<u32>,
    /// Enable CAN FD with this data bit rate in bit/s, or 2M
    #[arg(long, value_name = "BITRATE", value_parser = parse_bit_rate)]
    pub data_bitrate: Option<u32>,
    /// Sample point in % [default: from the gateway, or 75 to 87.5 with --bitrate]
    #[arg(long, value_name = "PERCENT", value_parser = parse_percent)]
    sample_point: Option<u16>,
    /// Sample point of the data phase in % [default: 75 to 87.5, chosen by the gateway]
    #[arg(long, value_name = "PERCENT", value_parser = parse_percent, requires = "data_bitrate")]
    data_sample_point: Option<u16>,
    /// PDO size per direction in chunks of 128 bytes, 1 to 24 [default: 3, with CAN FD 8]
    #[arg(long, value_name = "N")]
    pub pdo_n: Option<u8>,
    /// Allow PDO sizes above 11 chunks, for masters that support large PDOs
    #[arg(long)]
    pub large_pdos: bool,
    /// EtherCAT cycle time, in us
    #[arg(long, value_name = "US", default_value_t = 1000,
          value_parser = clap::value_parser!(u32).range(100..=100_000))]
    pub cycle_us: u32,
}

/// Default process data watchdog. Longer than the 100 ms of an application, because a computer without
/// real time may pause.
pub const WATCHDOG: Duration = Duration::from_secs(1);

impl SetupOptions {
    /// Configuration of the Adapter for these gateways.
    pub fn adapter(&self, port: &PortConfig) -> AdapterConfig {
        let count = u16::try_from(port.gateways.len()).unwrap_or(u16::MAX);
        let mut adapter = AdapterConfig::new(count)
            .with_cycle(Duration::from_micros(self.cycle_us.into()))
            .with_watchdog(WATCHDOG);
        for (slave, gateway) in adapter.slaves.iter_mut().zip(&port.gateways) {
            let n = self.pdo_n.unwrap_or_else(|| gateway.default_multiplier());
            (slave.rx_multiplier, slave.tx_multiplier) = (n, n);
        }
        adapter.allow_large_pdos = self.large_pdos;
        adapter
    }

    /// Configuration of a channel; `otherwise` returns the bit rates without an option.
    pub fn channel<E>(
        &self,
        otherwise: impl FnOnce() -> Result<ChannelConfig, E>,
    ) -> Result<ChannelConfig, E> {
        let mut settings = match (self.bitrate, self.data_bitrate) {
            (Some(bitrate), None) => ChannelConfig::classic(bitrate),
            (Some(bitrate), Some(data_bitrate)) => ChannelConfig::fd(bitrate, data_bitrate),
            (None, None) => otherwise()?,
            (None, Some(data_bitrate)) => {
                let nominal = otherwise()?.can;
                let mut settings = ChannelConfig::fd(nominal.nominal_bitrate, data_bitrate);
                settings.can.nominal_sample_point = nominal.nominal_sample_point;
                settings
            }
        };
        if let Some(permille) = self.sample_point {
            settings.can.nominal_sample_point = SamplePointWindow::exactly(permille);
        }
        if let Some(permille) = self.data_sample_point {
            settings.can.data_sample_point = SamplePointWindow::exactly(permille);
        }
        Ok(settings)
    }
}

/// Parses a percentage with at most one decimal, in per mille.
fn parse_percent(text: &str) -> Result<u16, String> {
    let wrong =
        || "expected a percentage below 100 with at most one decimal, for example 87.5".to_owned();
    let (whole, tenths) = text.split_once('.').unwrap_or((text, "0"));
    let is_number = |digits: &str| digits.bytes().all(|digit| digit.is_ascii_digit());
    if tenths.len() != 1 || !is_number(tenths) || !is_number(whole) {
        return Err(wrong());
    }
    let percent: u16 = whole.parse().map_err(|_| wrong())?;
    let tenths: u16 = tenths.parse().map_err(|_| wrong())?;
    if percent < 100 { Ok(percent * 10 + tenths) } else { Err(wrong()) }
}

#[cfg(test)]
mod tests {
    use super::parse_percent;

    #[test]
    fn sample_points_are_percent() {
        assert_eq!(parse_percent("80"), Ok(800));
        assert_eq!(parse_percent("87.5"), Ok(875));
        for wrong in ["", "100", "0.875x", "87.55", "-1", "+5", "87.", "70000"] {
            assert!(parse_percent(wrong).is_err(), "{wrong}");
        }
    }
}
