//! The bit rates that channels are tested at.

use std::path::Path;

use ecan_config_file::ConfigFile;
use ecan_mcan_port::ChannelConfig;
use ecan_protocol::config::{McanChannelConfig, NodeMode};

use crate::config_file;
use crate::failure::Failure;

/// The list without a file: nominal and data bit rate in bit/s.
const USUAL: [(u32, Option<u32>); 6] = [
    (125_000, None),
    (250_000, None),
    (500_000, None),
    (1_000_000, None),
    (500_000, Some(2_000_000)),
    (1_000_000, Some(5_000_000)),
];

/// One way to set a channel's bit rates.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Rate {
    can: McanChannelConfig,
}

impl Rate {
    /// The list without a file.
    pub(super) fn usual() -> Vec<Self> {
        let settings = USUAL.map(|(nominal, data)| plain(nominal, data));
        settings.into_iter().map(|it| Self { can: it.can }).collect()
    }

    /// Every one of a file, each once, in the file's order.
    pub(super) fn of_file(file: &ConfigFile) -> Vec<Self> {
        let mut rates = Vec::new();
        for channel in file.port.gateways.iter().flat_map(|it| it.channels.iter().flatten()) {
            let own = channel.can;
            let mut can = plain(own.nominal_bitrate, own.fd.then_some(own.data_bitrate)).can;
            can.bit_timing_mode = own.bit_timing_mode;
            can.nominal_sample_point = own.nominal_sample_point;
            can.manual_nominal = own.manual_nominal;
            can.non_iso = own.non_iso;
            // In classic CAN nothing of the data phase has an effect.
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

    /// A channel with these bit rates.
    pub(super) fn channel(&self, mode: NodeMode) -> ChannelConfig {
        let data = self.is_fd().then_some(self.can.data_bitrate);
        let mut settings = plain(self.can.nominal_bitrate, data);
        settings.can = McanChannelConfig { node_mode: mode, ..self.can };
        settings
    }

    pub(super) fn is_fd(&self) -> bool {
        self.can.fd
    }

    /// As in `500 kbit/s` or `500/2000 kbit/s FD`.
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

    /// In bit/s: nominal, and data with CAN FD.
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

/// Reads a file that must be sound and have a channel.
pub(super) fn read(path: &Path) -> Result<ConfigFile, Failure> {
    let file = config_file::read(path)?;
    if Rate::of_file(&file).is_empty() {
        let reason = "it has no channel, so there is no bit rate to test".to_owned();
        return Err(Failure::File { what: "use", path: path.to_owned(), reason });
    }
    Ok(file)
}
