//! Channels of a command, their bit rates, and the frames of a recording for them.

use std::collections::BTreeMap;
use std::fmt;
use std::path::Path;
use std::str::FromStr;

use clap::Args;
use ecan_can_io::recording::{LoggedFrame, ReadOptions, Recording, ScreenTimes};
use ecan_mcan_port::{ChannelConfig, PortConfig};
use ecan_protocol::config::{BitTimingMode, ConfigObject, McanChannelConfig};
use ecan_protocol::mapping::CHANNELS;
use ecan_protocol::text::Printable;
use ecan_tool_support::command_line::log_file;

use crate::context::{Bus, Failure, Result, note};

/// One or several channels of a gateway: `0`, `can0`, `0,2` or `all`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Channels {
    mask: u8,
    /// True if `all` was given.
    is_all: bool,
}

impl Channels {
    pub const ALL: Self = Self { mask: (1 << CHANNELS) - 1, is_all: true };

    pub const NONE: Self = Self::of_mask(0);

    pub fn only(channel: u8) -> Self {
        Self::of_mask(1 << channel)
    }

    pub const fn of_mask(mask: u8) -> Self {
        Self { mask, is_all: false }
    }

    pub fn is_all(self) -> bool {
        self.is_all
    }

    pub fn iter(self) -> impl Iterator<Item = u8> {
        (0..CHANNELS as u8).filter(move |channel| self.contains(*channel))
    }

    /// Gateway and channel for the frames of a recorded interface. With one channel, all frames go
    /// to it on the first gateway; with several, `canN` goes to channel N, counted over all
    /// gateways. `None` for other interfaces.
    pub fn destination_of(self, interface: &str, gateways: usize) -> Option<(usize, u8)> {
        let mut chosen = self.iter();
        if let (Some(only), None) = (chosen.next(), chosen.next()) {
            return Some((0, only));
        }
        let digits = interface.trim_start_matches(|c: char| !c.is_ascii_digit());
        let number: usize = digits.parse().ok()?;
        let (gateway, channel) = (number / CHANNELS, (number % CHANNELS) as u8);
        (gateway < gateways && self.contains(channel)).then_some((gateway, channel))
    }

    pub fn intersection(self, other: Self) -> Self {
        Self::of_mask(self.mask & other.mask)
    }

    pub fn contains(self, channel: u8) -> bool {
        self.mask.checked_shr(channel.into()).is_some_and(|mask| mask & 1 == 1)
    }
}

impl FromStr for Channels {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        if text == "all" {
            return Ok(Self::ALL);
        }
        text.split(',').try_fold(Self::NONE, |channels, name| match parse_channel(name) {
            Ok(channel) => Ok(Self::of_mask(channels.mask | 1 << channel)),
            Err(_) => Err("expected channels 0 to 3, comma-separated, or all".to_owned()),
        })
    }
}

impl fmt::Display for Channels {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let numbers: Vec<_> = self.iter().map(|channel| channel.to_string()).collect();
        match numbers.as_slice() {
            [] => write!(f, "no channel"),
            [only] => write!(f, "channel {only}"),
            several => write!(f, "channels {}", several.join(", ")),
        }
    }
}

#[derive(Clone, Copy, Debug, Args)]
pub struct ChannelArgument {
    /// CAN channel, 0 to 3
    #[arg(long, value_name = "N", value_parser = parse_channel)]
    pub channel: u8,
}

/// Parses a channel 0 to 3, also written as `can0`.
pub fn parse_channel(text: &str) -> Result<u8, String> {
    let number = text.strip_prefix("can").or_else(|| text.strip_prefix("CAN")).unwrap_or(text);
    let channel = number.parse().ok().filter(|channel| usize::from(*channel) < CHANNELS);
    channel.ok_or_else(|| "expected a channel, 0 to 3".to_owned())
}

/// CAN configuration of a channel; `None` if the channel is disabled.
pub fn can_config(config: &PortConfig, gateway: usize, channel: u8) -> Option<&McanChannelConfig> {
    let gateway = config.gateways.get(gateway)?;
    gateway.channels.get(usize::from(channel))?.as_ref().map(|channel| &channel.can)
}

/// Returns whether an argument is a channel name, which can-utils accept as an interface.
pub fn names_channel(text: &str) -> bool {
    parse_channel(text).is_ok()
}

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
pub fn bit_rates_of(bus: &Bus, slave: usize, channel: u8) -> Result<ChannelConfig> {
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

#[derive(Clone, Debug)]
pub struct Recorded {
    pub gateway: usize,
    pub channel: u8,
    pub logged: LoggedFrame,
}

#[derive(Clone, Debug)]
pub struct RecordedLog {
    /// Frames, at least one.
    pub frames: Vec<Recorded>,
    pub error_frames: usize,
    /// As in [`Recording::screen_times`].
    pub screen_times: Option<ScreenTimes>,
}

/// Reads the frames for the selected channels of a number of gateways; see [`Channels::destination_of`]. Reports what
/// is left out.
pub fn read_recording(
    path: &Path,
    options: &ReadOptions,
    channels: Channels,
    gateways: usize,
) -> Result<RecordedLog> {
    let recording = log_file::read_with(path, options)?;
    let mut losses = log_file::losses(path, &recording);
    let Recording { frames, error_frames, screen_times, .. } = recording;
    let mut others: BTreeMap<String, u64> = BTreeMap::new();
    let assign = |logged: LoggedFrame| {
        let Some((gateway, channel)) = channels.destination_of(&logged.interface, gateways) else {
            *others.entry(logged.interface).or_default() += 1;
            return None;
        };
        Some(Recorded { gateway, channel, logged })
    };
    let frames: Vec<_> = frames.into_iter().filter_map(assign).collect();
    let others: Vec<_> =
        others.iter().map(|(name, count)| format!("{} ({count})", Printable(name))).collect();
    if !others.is_empty() && !frames.is_empty() {
        losses.push(format!("frames of other interfaces left out: {}", others.join(", ")));
    }
    losses.iter().for_each(|loss| note(format_args!("# {loss}")));
    match frames.is_empty() {
        false => Ok(RecordedLog { frames, error_frames, screen_times }),
        true => {
            let message =
                format!("{} has no frames for the selected channels", Printable(path.display()));
            Err(Failure::Usage(message))
        }
    }
}

#[cfg(test)]
mod tests {
    use ecan_sim::{ClockKind, SimOptions};

    use super::*;

    #[test]
    fn channels_parse_numbers_and_all() {
        let parse = |text: &str| {
            text.parse::<Channels>().map(|channels| channels.iter().collect::<Vec<_>>())
        };
        assert_eq!(parse("2"), Ok(vec![2]));
        assert_eq!(parse("3,0"), Ok(vec![0, 3]));
        assert_eq!(parse("can1"), Ok(vec![1]));
        assert_eq!(parse("can3,0"), Ok(vec![0, 3]));
        assert_eq!(parse("all"), Ok(vec![0, 1, 2, 3]));
        assert_eq!("2,1".parse::<Channels>().unwrap().to_string(), "channels 1, 2");
        assert_eq!(Channels::only(3).to_string(), "channel 3");
        assert_eq!(Channels::NONE.to_string(), "no channel");
        for wrong in ["", "4", "0,", "-1", "0-3", "every", "can", "can4", "canal"] {
            assert!(parse(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn recorded_interfaces_map_to_channels() {
        let two: Channels = "0,2".parse().unwrap();
        let one = Channels::only(3);
        assert_eq!(one.destination_of("vcan7", 1), Some((0, 3)));
        assert_eq!(two.destination_of("can2", 1), Some((0, 2)));
        assert_eq!(two.destination_of("can1", 1), None);
        assert_eq!(Channels::ALL.destination_of("vcan7", 1), None);
        assert_eq!(Channels::ALL.destination_of("vcan7", 2), Some((1, 3)));
        assert_eq!(two.destination_of("can6", 2), Some((1, 2)));
        assert_eq!(Channels::ALL.destination_of("eth", 1), None);
    }

    #[test]
    fn bit_timing_is_read_from_the_gateway() {
        let options = SimOptions { clock: Some(ClockKind::Stepped), ..SimOptions::default() };
        let backend = ecan_sim::open_scenario(ecan_sim::echo(1), &options).unwrap();
        let bus = Bus::over(&backend.ecrt);
        let channel = |channel| bit_rates_of(&bus, 0, channel).unwrap().can;
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
