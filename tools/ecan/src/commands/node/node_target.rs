//! Selection of a CANopen node.

use std::fmt;
use std::path::PathBuf;
use std::str::FromStr;
use std::sync::Arc;

use clap::Args;
use ecan_canopen::{DeviceFile, NodeDescription, NodeId};
use serde::Serialize;

use crate::config_file;
use crate::configured_node::ConfiguredNodes;
use crate::context::{Context, Failure, Result};
use crate::frames::{FrameOptions, parse_channel};
use crate::slave_choice::SlaveChoice;
use crate::via;

/// A node-ID, channel and node-ID with a dot, or a name of a configuration file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum NodeArgument {
    Id { channel: Option<u8>, node: NodeId },
    Name(String),
}

impl FromStr for NodeArgument {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        match parse_id(text) {
            Err(_) if text.starts_with(char::is_alphabetic) => Ok(Self::Name(text.to_owned())),
            parsed => parsed,
        }
    }
}

fn parse_id(text: &str) -> Result<NodeArgument, String> {
    let (channel, node) = match text.split_once('.') {
        Some((channel, node)) => (Some(parse_channel(channel)?), node),
        None => (None, text),
    };
    let node = crate::value::parse_unsigned(node).and_then(|it| u8::try_from(it).ok());
    let node = node.and_then(NodeId::new);
    let wrong = || {
        "expected a node-ID, 1 to 127, CHANNEL.ID, for example 0.5, or a name of --config"
            .to_owned()
    };
    Ok(NodeArgument::Id { channel, node: node.ok_or_else(wrong)? })
}

/// Options that select one node.
#[derive(Clone, Debug, Args)]
pub struct TargetArguments {
    /// Node-ID, 1 to 127, CHANNEL.ID, or a name of the configuration file (--config)
    #[arg(long, value_name = "NODE")]
    node: NodeArgument,
    /// CAN channel, 0 to 3 [default: 0]
    #[arg(long, value_name = "N", value_parser = parse_channel)]
    channel: Option<u8>,
}

impl TargetArguments {
    /// As [`NodeArgument::select`].
    pub fn select(&self, options: &FrameOptions, context: &Context) -> Result<SelectedNode> {
        self.node.select(self.channel, options, context)
    }
}

/// Options that select one node, which can also be an argument without a name.
#[derive(Clone, Debug, Args)]
pub struct PositionalTarget {
    /// Node-ID, 1 to 127, CHANNEL.ID, or a name of the configuration file (--config)
    #[arg(value_name = "NODE", required_unless_present = "node", conflicts_with = "node")]
    target: Option<NodeArgument>,
    /// The same as an option
    #[arg(long, value_name = "NODE")]
    node: Option<NodeArgument>,
    /// CAN channel, 0 to 3 [default: 0]
    #[arg(long, value_name = "N", value_parser = parse_channel)]
    channel: Option<u8>,
}

impl PositionalTarget {
    /// As [`NodeArgument::select`].
    pub fn select(&self, options: &FrameOptions, context: &Context) -> Result<SelectedNode> {
        let node = self.target.as_ref().or(self.node.as_ref());
        let node = node.ok_or_else(|| Failure::Usage("no node selected; use --node".to_owned()))?;
        node.select(self.channel, options, context)
    }
}

impl NodeArgument {
    /// The node: on the channel of the argument, else on this one, else on channel 0; or the one of
    /// the configuration file with this name.
    ///
    /// # Errors
    /// The file cannot be used or has no such node; options contradict each other.
    pub fn select(
        &self,
        channel: Option<u8>,
        options: &FrameOptions,
        context: &Context,
    ) -> Result<SelectedNode> {
        let file =
            options.gateway.setup.config.as_deref().map(ConfiguredNodes::load).transpose()?;
        match (self, file) {
            (Self::Id { channel: of_node, node }, file) => {
                let target = target(*of_node, *node, channel).map_err(Failure::Usage)?;
                let by_file =
                    |it: &ConfiguredNodes| it.of_only_gateway(target.channel, node.get()).cloned();
                let description = file.as_ref().and_then(by_file);
                SelectedNode::new(target, description, None, file, options, context)
            }
            (Self::Name(name), None) => Err(Failure::Usage(format!(
                "the node \"{name}\" needs the configuration file that names it: --config FILE; \
                 without it select the node by its node-ID, 1 to 127, or CHANNEL.ID"
            ))),
            (Self::Name(name), Some(file)) => {
                context.global.without_slave("the configuration file states the gateway")?;
                let found = file.named(name)?.clone();
                let address = found.address;
                if let Some(other) = channel.filter(|it| *it != address.channel) {
                    return Err(Failure::Usage(format!(
                        "node \"{name}\" and --channel {other} name different channels"
                    )));
                }
                let target = NodeTarget { channel: address.channel, node: address.node };
                let slave = file.slave_of(address.slave)?;
                SelectedNode::new(target, Some(found), slave, Some(file), options, context)
            }
        }
    }
}

fn target(of_node: Option<u8>, node: NodeId, channel: Option<u8>) -> Result<NodeTarget, String> {
    match (of_node, channel) {
        (Some(one), Some(other)) if one != other => {
            Err(format!("--node {one}.{node} and --channel {other} name different channels"))
        }
        (of_node, channel) => Ok(NodeTarget { channel: of_node.or(channel).unwrap_or(0), node }),
    }
}

/// A node, and how it is reached.
#[derive(Clone, Debug)]
pub struct SelectedNode {
    pub target: NodeTarget,
    /// Description of the node in the configuration file.
    pub description: Option<NodeDescription>,
    /// The configuration file.
    pub config: Option<PathBuf>,
    /// Slave of its gateway; `None` is the selected or only one.
    pub slave: Option<SlaveChoice>,
    pub options: FrameOptions,
}

impl SelectedNode {
    fn new(
        target: NodeTarget,
        description: Option<NodeDescription>,
        slave: Option<SlaveChoice>,
        file: Option<ConfiguredNodes>,
        options: &FrameOptions,
        context: &Context,
    ) -> Result<Self> {
        let mut options = options.clone();
        if let Some(file) = &file {
            // A service has configured the gateways: then the file only describes nodes.
            let master = config_file::master(file.config(), context.global);
            if via::open(context.global, master)?.is_some() {
                options.gateway.setup.config = None;
            }
        }
        let config = file.map(|it| it.path().to_owned());
        Ok(Self { target, description, config, slave, options })
    }

    /// Device file of the node by the configuration file.
    pub fn device(&self) -> Option<&Arc<DeviceFile>> {
        self.description.as_ref()?.device.as_ref()
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
        let on = |text: &str, channel| match parse(text).unwrap() {
            NodeArgument::Id { channel: own, node } => target(own, node, channel),
            NodeArgument::Name(name) => panic!("{name}"),
        };
        let expected = |channel, node| NodeTarget { channel, node: NodeId::new(node).unwrap() };
        assert_eq!(on("5", None), Ok(expected(0, 5)));
        assert_eq!(on("2.0x7F", None), Ok(expected(2, 127)));
        assert_eq!(on("can1.3", None), Ok(expected(1, 3)));
        for wrong in ["0", "128", "4.1", "1.", "", "1.2.3", "-1"] {
            assert!(parse(wrong).is_err(), "{wrong}");
        }
        assert_eq!(on("2.5", Some(2)), Ok(expected(2, 5)));
        assert!(on("2.5", Some(1)).unwrap_err().contains("different channels"));
    }

    #[test]
    fn other_words_are_names() {
        for name in ["gripper", "left arm", "can1.x", "joint_1"] {
            assert_eq!(name.parse(), Ok(NodeArgument::Name(name.to_owned())));
        }
    }
}
