use std::path::Path;

use ecan_mcan_port::ChannelConfig;
use ecan_mcan_port::Config;
use ecan_protocol::config::{McanChannelConfig, NodeMode};

use crate::config_file;
use crate::context::{Failure, Result};

/// Default list: nominal and data bit rate in bit/s.
const USUAL: [(u32, Option<u32>); 6] = [
    (125_000, None),
    (250_000, None),
    (500_000, None),
    (1_000_000, None),
    (500_000, Some(2_000_000)),
    (1_000_000, Some(5_000_000)),
];

#[derive(Clone, Debug, PartialEq)]
pub(super) struct Rate {
    can: McanChannelConfig,
}

impl Rate {
    pub(super) fn usual() -> Vec<Self> {
        let settings = USUAL.map(|(nominal, data)| plain(nominal, data));
        settings.into_iter().map(|it| Self { can: it.can }).collect()
    }

    /// Bit rates of a file, without duplicates, in the order of the file.
    pub(super) fn of_file(file: &Config) -> Vec<Self> {
        let mut rates = Vec::new();
        for channel in file.port.gateways.iter().flat_map(|it| it.channels.iter().flatten()) {
            let own = channel.can;
            let mut can = plain(own.nominal_bitrate, own.fd.then_some(own.data_bitrate)).can;
            can.bit_timing_mode = own.bit_timing_mode;
            can.nominal_sample_point = own.nominal_sample_point;
            can.manual_nominal = own.manual_nominal;
            can.non_iso = own.non_iso;
            // The data phase has no effect in classic CAN.
            if own.fd {
                can.data_sample_point = own.data_sample_point;
                can.manual_data = own.manual_data;
                (can.tdc, can.tdc_offset, can.tdc_filter) =
                    (own.tdc, own.tdc_offset, own.tdc_filter);
            }
            let rate = Self { can };
            if !rates.contains(&rate) {
                rates.push(rate);
            }
        }
        rates
    }

    pub(super) fn of_channel(can: &McanChannelConfig) -> Self {
        Self { can: *can }
    }

    pub(super) fn channel(&self, mode: NodeMode) -> ChannelConfig {
        let data = self.is_fd().then_some(self.can.data_bitrate);
        let mut settings = plain(self.can.nominal_bitrate, data);
        settings.can = McanChannelConfig { node_mode: mode, ..self.can };
        settings
    }

    pub(super) fn is_fd(&self) -> bool {
        self.can.fd
    }

    /// Name such as `500 kbit/s` or `500/2000 kbit/s FD`.
    pub(super) fn name(&self) -> String {
        let kilo = |rate: u32| match rate % 1000 {
            0 => (rate / 1000).to_string(),
            _ => format!("{}", f64::from(rate) / 1000.0),
        };
        let nominal = kilo(self.can.nominal_bitrate);
        match self.can.fd {
            true => format!("{nominal}/{} kbit/s FD", kilo(self.can.data_bitrate)),
            false => format!("{nominal} kbit/s"),
        }
    }

    /// Nominal and, with CAN FD, data bit rate in bit/s.
    pub(super) fn bit_rates(&self) -> (u32, Option<u32>) {
        (self.can.nominal_bitrate, self.can.fd.then_some(self.can.data_bitrate))
    }
}

fn plain(nominal: u32, data: Option<u32>) -> ChannelConfig {
    match data {
        Some(data) => ChannelConfig::fd(nominal, data),
        None => ChannelConfig::classic(nominal),
    }
}

/// Reads a valid file with at least one channel.
pub(super) fn read(path: &Path) -> Result<Config> {
    let file = config_file::read(path)?;
    if Rate::of_file(&file).is_empty() {
        let reason = "the file has no channel and thus no bit rate to test";
        return Err(Failure::file("use", path, reason));
    }
    Ok(file)
}
