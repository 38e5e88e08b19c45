use std::str::FromStr;

use ecan_protocol::mapping::CHANNELS;

/// Pairs of channels, for example `0-1,2-3`; each channel at most once.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Wiring(Vec<(u8, u8)>);

impl Wiring {
    pub fn pairs(&self) -> &[(u8, u8)] {
        &self.0
    }
}

impl FromStr for Wiring {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let wrong = || "expected pairs of channels 0 to 3, for example 0-1,2-3".to_owned();
        let mut pairs = Vec::new();
        let mut is_used = [false; CHANNELS];
        for pair in text.split(',') {
            let (first, second) = pair.split_once('-').ok_or_else(wrong)?;
            let mut channel = |text: &str| {
                let channel: u8 = text.parse().map_err(|_| wrong())?;
                let used = is_used.get_mut(usize::from(channel)).ok_or_else(wrong)?;
                match std::mem::replace(used, true) {
                    true => Err(format!("channel {channel} is used twice")),
                    false => Ok(channel),
                }
            };
            pairs.push((channel(first)?, channel(second)?));
        }
        Ok(Self(pairs))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pairs_use_each_channel_once() {
        let parse = |text: &str| text.parse::<Wiring>();
        assert_eq!(parse("0-1,3-2"), Ok(Wiring(vec![(0, 1), (3, 2)])));
        for wrong in ["", "0", "0-4", "0-1,", "0:1", "a-b", "0-0", "0-1,1-2"] {
            assert!(parse(wrong).is_err(), "{wrong}");
        }
    }
}
