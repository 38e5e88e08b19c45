use std::fmt;

use ecan_mcan_port::ChannelConfig;
use ecan_protocol::config::{BitTimingMode, ConfigObject, McanChannelConfig};

use crate::context::{Bus, Failure, Result};

/// Entries of 0x8001..0x8004 for the bit timing besides the bit rates: timing mode, non-ISO CAN FD,
/// sample points (manual 13.4).
const TIMING: [u8; 6] = [7, 9, 21, 22, 23, 24];
const MANUAL_TIMING: [u8; 11] = [16, 25, 26, 27, 28, 29, 30, 31, 32, 33, 34];

/// Nominal bit rate and, with CAN FD, data bit rate, in bit/s.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BitRates {
    nominal: u32,
    data: Option<u32>,
}

impl BitRates {
    pub fn of(can: &McanChannelConfig) -> Self {
        Self { nominal: can.nominal_bitrate, data: can.fd.then_some(can.data_bitrate) }
    }
}

impl fmt::Display for BitRates {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.data {
            None => write!(f, "{} bit/s", self.nominal),
            Some(data) => write!(f, "{}/{data} bit/s", self.nominal),
        }
    }
}

/// Reads the bit timing of a channel from the gateway; all else is default.
pub fn of_gateway(bus: &Bus, slave: usize, channel: u8) -> Result<ChannelConfig> {
    let index = 0x8001 + u16::from(channel);
    let read = |subindex| bus.read(slave, index, subindex);
    let nominal = read(19)?;
    let mut settings = match read(15)? {
        0 => ChannelConfig::classic(nominal),
        _ => ChannelConfig::fd(nominal, read(20)?),
    };
    let mut take = |subindex| {
        let value = read(subindex)?;
        settings.can.set_value(subindex, value).map_err(|_| {
            Failure::Rejected(format!(
                "invalid value {value} in 0x{index:04X}:{subindex:02} of the gateway; \
                 set the bit rate with --bitrate"
            ))
        })
    };
    TIMING.into_iter().try_for_each(&mut take)?;
    if read(7)? == u32::from(BitTimingMode::Manual as u8) {
        MANUAL_TIMING.into_iter().try_for_each(&mut take)?;
    }
    Ok(settings)
}

#[cfg(test)]
mod tests {
    use ecan_sim::{ClockKind, SimOptions};

    use super::*;

    #[test]
    fn bit_timing_is_read_from_the_gateway() {
        let options = SimOptions { clock: Some(ClockKind::Stepped), ..SimOptions::default() };
        let backend = ecan_sim::open_scenario(ecan_sim::echo(1), &options).unwrap();
        let bus = Bus::over(&backend.ecrt);
        let channel = |channel| of_gateway(&bus, 0, channel).unwrap().can;
        assert_eq!(BitRates::of(&channel(2)).to_string(), "500000/5000000 bit/s");
        let set = |subindex, value| bus.write(0, 0x8003, subindex, value).unwrap();
        set(19, 250_000);
        set(15, 0);
        set(21, 800);
        set(22, 800);
        let can = channel(2);
        assert_eq!(BitRates::of(&can).to_string(), "250000 bit/s");
        assert_eq!((can.nominal_sample_point.min, can.nominal_sample_point.max), (800, 800));
        assert_eq!(can.ram, ChannelConfig::classic(250_000).can.ram);
        set(7, 1);
        set(25, 4);
        assert_eq!(channel(2).manual_nominal.brp, 4);
        // The other channels have their own.
        assert_eq!(BitRates::of(&channel(1)).to_string(), "500000/5000000 bit/s");
    }
}
