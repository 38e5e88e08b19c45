//! What the commands that carry frames are told about the gateway and its channels.

use std::time::Duration;

use std::path::PathBuf;

use clap::Args;
use ecan_command_line::real_time::RealTimeArguments;
use ecan_host::AdapterConfig;
use ecan_mcan_port::ChannelConfig;
use ecan_protocol::config::SamplePointWindow;

use crate::frames::capture::CaptureOptions;

/// Options of the commands that carry frames.
#[derive(Debug, Args)]
pub struct FrameOptions {
    #[command(flatten)]
    pub capture: CaptureOptions,
    #[command(flatten)]
    pub gateway: GatewayOptions,
}

/// Options whose values a configuration file has.
const OF_THE_FILE: [&str; 7] = [
    "bitrate",
    "data_bitrate",
    "sample_point",
    "data_sample_point",
    "pdo_n",
    "large_pdos",
    "cycle_us",
];

/// What a command is told about the gateway, its channels and its own thread.
#[derive(Debug, Args)]
pub struct GatewayOptions {
    #[command(
        flatten,
        next_help_heading = "Gateway: so it stays until its power is cycled, and `config save` would \
                             store it"
    )]
    pub setup: SetupOptions,
    #[command(flatten)]
    pub real_time: RealTimeArguments,
}

/// What a gateway and its channels are to be set to.
#[derive(Clone, Debug, Args)]
pub struct SetupOptions {
    /// Take everything about the gateway from this configuration file, see `ecan config`: its place,
    /// PDO size, profiles, channels with bit rates and filters, data path, cycle, clocks
    #[arg(long, value_name = "FILE", conflicts_with_all = OF_THE_FILE)]
    pub config: Option<PathBuf>,
    /// Nominal bit rate in bit/s; classic CAN, unless there is a data bit rate too
    /// [default: the bit rates that the gateway is set to, of a plan 500000]
    #[arg(long, value_name = "BITRATE")]
    pub bitrate: Option<u32>,
    /// Use CAN FD, with this data bit rate in bit/s
    #[arg(long, value_name = "BITRATE")]
    pub data_bitrate: Option<u32>,
    /// Sample point in percent [default: as the gateway is set, or 75 to 87.5 with --bitrate]
    #[arg(long, value_name = "PERCENT", value_parser = parse_percent)]
    sample_point: Option<u16>,
    /// Sample point of the data phase in percent [default: 75 to 87.5, as the gateway finds it]
    #[arg(long, value_name = "PERCENT", value_parser = parse_percent, requires = "data_bitrate")]
    data_sample_point: Option<u16>,
    /// PDO size per direction, in chunks of 128 bytes
    #[arg(long, value_name = "N", default_value_t = 5)]
    pub pdo_n: u8,
    /// The installed master carries more than 1486 bytes of process data per sync manager
    #[arg(long)]
    pub large_pdos: bool,
    /// EtherCAT cycle in microseconds
    #[arg(long, value_name = "US", default_value_t = 1000,
          value_parser = clap::value_parser!(u32).range(100..=100_000))]
    pub cycle_us: u32,
}

/// Process data watchdog of a gateway that no file configures: a tool on a computer without real
/// time may pause for longer than the default of 100 ms.
pub const WATCHDOG: Duration = Duration::from_secs(1);

impl SetupOptions {
    /// So many gateways on the EtherCAT line.
    pub fn adapter(&self, count: u16) -> AdapterConfig {
        let mut adapter = AdapterConfig::new(count)
            .with_multiplier(self.pdo_n)
            .with_cycle(Duration::from_micros(self.cycle_us.into()))
            .with_watchdog(WATCHDOG);
        adapter.allow_large_pdos = self.large_pdos;
        adapter
    }

    /// One CAN channel; `otherwise` is asked for the bit rates that no option names.
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

/// Percent with at most one decimal, as thousandths.
fn parse_percent(text: &str) -> Result<u16, String> {
    let wrong = || "expected percent with at most one decimal, as in 87.5".to_owned();
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
