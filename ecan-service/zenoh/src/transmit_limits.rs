//! Limits of the frames that remote clients may send.

use std::fmt;
use std::str::FromStr;

use ecan_protocol::can::CanId;
use ecan_protocol::mapping::CHANNELS;
use ecan_protocol::text::Printable;
use ecan_service::client::{NOT_PERMITTED, RpcError};
use thiserror::Error;

/// A channel, and the CAN IDs that remote clients may send there.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TransmitRule {
    gateway: u16,
    channel: u8,
    /// First and last CAN ID, both standard or both extended; `None` for all.
    ids: Option<(CanId, CanId)>,
}

/// The text is not a rule.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error(
    "transmit limit \"{}\" is invalid; allowed: GATEWAY.CHANNEL, GATEWAY.CHANNEL:ID or \
     GATEWAY.CHANNEL:FIRST-LAST, channels 0 to 3, CAN IDs of 3 or 8 hexadecimal digits",
    Printable(.0)
)]
pub struct TransmitRuleError(pub String);

impl FromStr for TransmitRule {
    type Err = TransmitRuleError;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        parse(text).ok_or_else(|| TransmitRuleError(text.to_owned()))
    }
}

fn parse(text: &str) -> Option<TransmitRule> {
    let (address, ids) = text.split_once(':').map_or((text, None), |(a, ids)| (a, Some(ids)));
    let (gateway, channel) = address.split_once('.')?;
    let (gateway, channel) = (gateway.parse().ok()?, channel.parse().ok()?);
    let ids = match ids {
        None => None,
        Some(ids) => {
            let (first, last) = ids.split_once('-').unwrap_or((ids, ids));
            let (first, last) = (parse_id(first)?, parse_id(last)?);
            let is_range = first.is_extended() == last.is_extended() && first <= last;
            Some(is_range.then_some((first, last))?)
        }
    };
    (usize::from(channel) < CHANNELS).then_some(TransmitRule { gateway, channel, ids })
}

/// The number of digits distinguishes standard and extended CAN IDs, as in candump.
fn parse_id(digits: &str) -> Option<CanId> {
    if !digits.bytes().all(|digit| digit.is_ascii_hexdigit()) {
        return None;
    }
    let raw = u32::from_str_radix(digits, 16).ok()?;
    match digits.len() {
        3 => CanId::new(raw, false).ok(),
        8 => CanId::new(raw, true).ok(),
        _ => None,
    }
}

impl TransmitRule {
    fn permits(&self, gateway: u16, channel: u8, id: CanId) -> bool {
        // The order has the standard CAN IDs before the extended ones.
        let is_in = |(first, last): (CanId, CanId)| (first..=last).contains(&id);
        (self.gateway, self.channel) == (gateway, channel) && self.ids.is_none_or(is_in)
    }
}

/// Frames that remote clients with control may send: all without a rule, otherwise those that a rule
/// permits.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct TransmitLimits {
    /// The rules.
    pub rules: Vec<TransmitRule>,
}

impl TransmitLimits {
    /// Checks a frame of a remote client.
    pub(crate) fn check(&self, gateway: u16, channel: u8, id: CanId) -> Result<(), RpcError> {
        let is_permitted = self.rules.is_empty()
            || self.rules.iter().any(|rule| rule.permits(gateway, channel, id));
        if is_permitted {
            return Ok(());
        }
        let text = format!(
            "CAN ID {id} on gateway {gateway} channel {channel} is not permitted to remote clients; \
             allowed: {self}"
        );
        Err(RpcError::new(NOT_PERMITTED, text))
    }
}

impl fmt::Display for TransmitRule {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}.{}", self.gateway, self.channel)?;
        match self.ids {
            None => Ok(()),
            Some((first, last)) if first == last => write!(f, ":{first}"),
            Some((first, last)) => write!(f, ":{first}-{last}"),
        }
    }
}

impl fmt::Display for TransmitLimits {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (number, rule) in self.rules.iter().enumerate() {
            write!(f, "{}{rule}", if number > 0 { ", " } else { "" })?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_pass_by_channel_and_can_id() {
        let rules = ["0.1:100-1FF", "0.1:18FF0000", "1.0"].map(|text| text.parse().unwrap());
        let limits = TransmitLimits { rules: rules.to_vec() };
        let standard = |id| CanId::new(id, false).unwrap();
        let extended = |id| CanId::new(id, true).unwrap();
        for (gateway, channel, id) in [
            (0, 1, standard(0x100)),
            (0, 1, standard(0x1ff)),
            (0, 1, extended(0x18ff_0000)),
            (1, 0, standard(0)),
            (1, 0, extended(5)),
        ] {
            assert_eq!(limits.check(gateway, channel, id), Ok(()));
            assert_eq!(TransmitLimits::default().check(gateway, channel, id), Ok(()));
        }
        for (gateway, channel, id) in [
            (0, 1, standard(0xff)),
            (0, 1, standard(0x200)),
            (0, 1, extended(0x100)),
            (0, 1, extended(0x18ff_0001)),
            (0, 0, standard(0x100)),
            (1, 1, standard(0x100)),
        ] {
            let error = limits.check(gateway, channel, id).unwrap_err();
            assert_eq!(error.code, NOT_PERMITTED);
            assert!(error.message.ends_with("0.1:100-1FF, 0.1:18FF0000, 1.0"), "{error}");
        }
    }

    #[test]
    fn wrong_rules_are_rejected() {
        for text in [
            "",
            "0",
            "0.",
            ".1",
            "0.4",
            "a.1",
            "0.1:",
            "0.1:1",
            "0.1:800",
            "0.1:1ff-100",
            "0.1:100-00000200",
            "0.1:+10",
            "0.1:20000000",
            "0.1:100-",
            "65536.0",
        ] {
            let error = text.parse::<TransmitRule>().unwrap_err();
            assert!(error.to_string().contains("allowed: GATEWAY.CHANNEL"), "{text}: {error}");
        }
    }
}
