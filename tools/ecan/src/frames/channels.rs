//! Channels of a command.

use std::fmt;
use std::str::FromStr;

use clap::Args;
use ecan_mcan_port::PortConfig;
use ecan_protocol::config::McanChannelConfig;
use ecan_protocol::mapping::CHANNELS;

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
    text.starts_with("can") && parse_channel(text).is_ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn channels_parse_numbers_and_all() {
        let parse = |text: &str| text.parse::<Channels>().map(|it| it.iter().collect::<Vec<_>>());
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
}
