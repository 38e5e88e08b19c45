//! Names of endpoints, one for each channel.

use std::str::FromStr;

use crate::commands::bridge::lane_id::LaneId;

/// A name with the placeholders `%g` (index of the gateway) and `%c` (channel).
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NameTemplate(String);

impl NameTemplate {
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    pub fn name(&self, LaneId { gateway, channel }: LaneId) -> String {
        self.0.replace("%g", &gateway.to_string()).replace("%c", &channel.to_string())
    }
}

impl FromStr for NameTemplate {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let is_valid = text.split('%').skip(1).all(|rest| rest.starts_with(['g', 'c']));
        match is_valid {
            true => Ok(Self(text.to_owned())),
            false => Err("expected only %g (gateway) and %c (channel) after %".to_owned()),
        }
    }
}

/// Parses the name of a network interface, with placeholders.
pub fn parse_interface(text: &str) -> Result<NameTemplate, String> {
    let template: NameTemplate = text.parse()?;
    // All numbers have one digit in the usual case.
    let name = template.name(LaneId { gateway: 0, channel: 0 });
    let is_possible = (1..=15).contains(&name.len())
        && name.bytes().all(|byte| byte.is_ascii_graphic() && !matches!(byte, b'/' | b':'));
    match is_possible {
        true => Ok(template),
        false => Err("expected the name of a network interface, for example vcan0".to_owned()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn placeholders_are_replaced() {
        let name = |text: &str| {
            text.parse::<NameTemplate>().map(|it| it.name(LaneId { gateway: 1, channel: 3 }))
        };
        assert_eq!(name("vcan0"), Ok("vcan0".to_owned()));
        assert_eq!(name("can%g%c"), Ok("can13".to_owned()));
        assert_eq!(name("c%c-g%g"), Ok("c3-g1".to_owned()));
        for wrong in ["can%", "can%d", "can%%c"] {
            assert!(name(wrong).is_err(), "{wrong}");
        }
        assert!(parse_interface("thirteen_and%g%c").is_ok());
        assert!(parse_interface("fourteen__and_%g%c").is_err());
    }
}
