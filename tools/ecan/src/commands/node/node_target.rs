//! Selection of a CANopen node.

use std::fmt;
use std::str::FromStr;

use clap::Args;
use ecan_canopen::NodeId;
use serde::Serialize;

use crate::frames::parse_channel;

/// `--node`: a node-ID, or channel and node-ID with a dot.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NodeArgument {
    channel: Option<u8>,
    node: NodeId,
}

impl FromStr for NodeArgument {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let (channel, node) = match text.split_once('.') {
            Some((channel, node)) => (Some(parse_channel(channel)?), node),
            None => (None, text),
        };
        let node = crate::value::parse_unsigned(node).and_then(|it| u8::try_from(it).ok());
        let node = node.and_then(NodeId::new);
        let wrong = || "expected a node-ID, 1 to 127, or CHANNEL.ID, for example 0.5".to_owned();
        Ok(Self { channel, node: node.ok_or_else(wrong)? })
    }
}

/// Options that select one node.
#[derive(Clone, Copy, Debug, Args)]
pub struct TargetArguments {
    /// Node-ID, 1 to 127, or CHANNEL.ID
    #[arg(long, value_name = "ID")]
    node: NodeArgument,
    /// CAN channel, 0 to 3 [default: 0]
    #[arg(long, value_name = "N", value_parser = parse_channel)]
    channel: Option<u8>,
}

impl TargetArguments {
    /// The node; `--channel` and the channel of `--node` exclude each other unless they are equal.
    pub fn target(&self) -> Result<NodeTarget, String> {
        self.node.target(self.channel)
    }
}

impl NodeArgument {
    /// The node on the channel of the argument, else on this one, else on channel 0.
    pub fn target(self, channel: Option<u8>) -> Result<NodeTarget, String> {
        match (self.channel, channel) {
            (Some(one), Some(other)) if one != other => Err(format!(
                "--node {one}.{} and --channel {other} name different channels",
                self.node
            )),
            (of_node, channel) => {
                Ok(NodeTarget { channel: of_node.or(channel).unwrap_or(0), node: self.node })
            }
        }
    }
}

/// A node of the gateway.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct NodeTarget {
    pub channel: u8,
    pub node: NodeId,
}

impl fmt::Display for NodeTarget {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "node {} on can{}", self.node, self.channel)
    }
}

/// Address of a node in JSON.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct JsonTarget {
    pub slave: usize,
    pub channel: u8,
    pub node: u8,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn node_may_name_its_channel() {
        let parse = |text: &str| text.parse::<NodeArgument>();
        let node = |text: &str| parse(text).unwrap().target(None).unwrap();
        let target = |channel, node| NodeTarget { channel, node: NodeId::new(node).unwrap() };
        assert_eq!(node("5"), target(0, 5));
        assert_eq!(node("2.0x7F"), target(2, 127));
        assert_eq!(node("can1.3"), target(1, 3));
        for wrong in ["0", "128", "4.1", "1.", "", "1.2.3", "-1"] {
            assert!(parse(wrong).is_err(), "{wrong}");
        }
        let both = |channel| parse("2.5").unwrap().target(Some(channel));
        assert_eq!(both(2), Ok(target(2, 5)));
        assert!(both(1).unwrap_err().contains("different channels"));
    }
}
