//! Options of the node commands: selection of a CANopen node, and the end of a live view.

use std::fmt;
use std::path::PathBuf;
use std::str::FromStr;
use std::sync::Arc;

use clap::Args;
use ecan_canopen::{DeviceFile, NodeDescription, NodeId};
use ecan_tool_support::command_line::options::{ANY_TIME, milliseconds};
use serde::Serialize;

use crate::config_file::ConfiguredNodes;
use crate::context::{Context, Failure, Result};
use crate::frames::{FrameOptions, Service, parse_channel};
use crate::slave_choice::SlaveChoice;
use crate::{config_file, context};

/// Node-ID with or without its channel: `5`, `0.5`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NodeIdArgument {
    channel: Option<u8>,
    node: NodeId,
}

impl FromStr for NodeIdArgument {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let (channel, node) = match text.split_once('.') {
            Some((channel, node)) => (Some(parse_channel(channel)?), node),
            None => (None, text),
        };
        let node = crate::value::parse_unsigned(node).and_then(|number| u8::try_from(number).ok());
        let wrong = || "expected a node-ID, 1 to 127, or CHANNEL.ID, for example 0.5".to_owned();
        Ok(Self { channel, node: node.and_then(NodeId::from_raw).ok_or_else(wrong)? })
    }
}

impl NodeIdArgument {
    /// The node: on the channel of the argument, else on this one, else on channel 0.
    ///
    /// # Errors
    /// Both channels are stated, and differ.
    pub fn on(self, channel: Option<u8>) -> Result<NodeTarget> {
        let Self { channel: own, node } = self;
        match (own, channel) {
            (Some(one), Some(other)) if one != other => Err(Failure::Usage(format!(
                "--node {one}.{node} and --channel {other} name different channels"
            ))),
            (own, channel) => Ok(NodeTarget { channel: own.or(channel).unwrap_or(0), node }),
        }
    }
}

/// A node-ID, or a name of a configuration file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum NodeArgument {
    Id(NodeIdArgument),
    Name(String),
}

impl FromStr for NodeArgument {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        match text.parse() {
            Ok(id) => Ok(Self::Id(id)),
            Err(_) if text.starts_with(char::is_alphabetic) => Ok(Self::Name(text.to_owned())),
            Err(wrong) => Err(format!("{wrong}; a name starts with a letter")),
        }
    }
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

/// Options that select one node, for commands without an argument: these also accept the node without a name.
#[derive(Clone, Debug, Args)]
pub struct PositionalTarget {
    #[arg(value_name = "NODE", hide = true, conflicts_with = "node")]
    target: Option<NodeArgument>,
    /// Node-ID, 1 to 127, CHANNEL.ID, or a name of the configuration file (--config)
    #[arg(long, value_name = "NODE", required_unless_present = "target")]
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
    /// The node, as [`NodeIdArgument::on`], or the one of the configuration file with this name.
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
            (Self::Id(node), file) => {
                let target = node.on(channel)?;
                let NodeTarget { channel, node } = target;
                let description =
                    file.as_ref().and_then(|file| file.of_only_gateway(channel, node)).cloned();
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
                if let Some(other) = channel.filter(|channel| *channel != address.channel) {
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
            if context::open(context.global, master)?.is_some() {
                options.gateway.setup.config = None;
            }
        }
        let config = file.map(|file| file.path().to_owned());
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

/// Options that end a live view. The command has the option `--watch`.
#[derive(Clone, Copy, Debug, Args)]
pub struct LiveViewArguments {
    /// With --watch: exit after this number of lines, at least 1
    #[arg(short = 'n', long, value_name = "COUNT", requires = "watch",
          value_parser = clap::value_parser!(u64).range(1..))]
    count: Option<u64>,
    /// With --watch: exit if nothing is received for this time
    #[arg(short = 'T', long, value_name = "TIME", requires = "watch", value_parser = milliseconds::<u64>(ANY_TIME))]
    timeout: Option<u64>,
}

impl LiveViewArguments {
    /// Returns whether the view ends without the user.
    pub fn has_end(&self) -> bool {
        self.count.is_some() || self.timeout.is_some()
    }

    /// Starts the view now.
    pub fn start(&self, service: &Service) -> LiveView {
        self.start_at(service.now_ns(), service.response_ns())
    }

    fn start_at(&self, start_ns: u64, last_ns: u64) -> LiveView {
        let timeout_ns = self.timeout.map(|ms| ms.saturating_mul(1_000_000));
        LiveView { count: self.count, timeout_ns, start_ns, last_ns, printed: 0 }
    }
}

/// A live view: time and number of its lines.
#[derive(Clone, Copy, Debug)]
pub struct LiveView {
    /// Number of lines that is expected.
    pub count: Option<u64>,
    timeout_ns: Option<u64>,
    start_ns: u64,
    /// Observed time of the last reception.
    last_ns: u64,
    /// Number of lines so far.
    pub printed: u64,
}

impl LiveView {
    /// Time since the start, in seconds.
    pub fn seconds(&self, time_ns: u64) -> f64 {
        time_ns.saturating_sub(self.start_ns) as f64 / 1e9
    }

    /// Restarts the timeout.
    pub fn receive(&mut self, observed_ns: u64) {
        self.last_ns = observed_ns;
    }

    /// Counts a line; returns whether it is the last one.
    pub fn count_line(&mut self) -> bool {
        self.printed += 1;
        Some(self.printed) == self.count
    }

    /// Returns whether nothing was received for the timeout.
    pub fn has_timed_out(&self, observed_ns: u64) -> bool {
        self.timeout_ns.is_some_and(|limit| observed_ns.saturating_sub(self.last_ns) >= limit)
    }

    /// Observed time after a cycle; `None` if the user ended the view, which is its usual end without a count.
    ///
    /// # Errors
    /// Those of the cycle.
    pub fn after_cycle(&self, cycle: Result<u64>) -> Result<Option<u64>> {
        match cycle {
            Err(Failure::Incomplete(_)) if self.count.is_none() => Ok(None),
            cycle => cycle.map(Some),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn node_may_name_its_channel() {
        let on = |text: &str, channel| {
            assert!(matches!(text.parse(), Ok(NodeArgument::Id(_))), "{text}");
            text.parse::<NodeIdArgument>().unwrap().on(channel)
        };
        for (text, channel, expected) in [
            ("5", None, (0, 5)),
            ("5", Some(3), (3, 5)),
            ("2.0x7F", None, (2, 127)),
            ("2.5", Some(2), (2, 5)),
            ("can1.3", None, (1, 3)),
        ] {
            let target = on(text, channel).unwrap();
            assert_eq!((target.channel, target.node.get()), expected, "{text}");
        }
        let Err(Failure::Usage(message)) = on("2.5", Some(1)) else { panic!("accepted") };
        assert!(message.contains("different channels"), "{message}");
        for wrong in ["0", "128", "4.1", "1.", "", "1.2.3", "-1"] {
            assert!(wrong.parse::<NodeIdArgument>().is_err(), "{wrong}");
            assert!(wrong.parse::<NodeArgument>().is_err(), "{wrong}");
        }
        assert!("elbow".parse::<NodeIdArgument>().is_err());
    }

    #[test]
    fn other_words_are_names() {
        for name in ["gripper", "left arm", "can1.x", "joint_1"] {
            assert_eq!(name.parse(), Ok(NodeArgument::Name(name.to_owned())));
        }
    }

    const MS: u64 = 1_000_000;

    fn view(count: Option<u64>, timeout: Option<u64>) -> LiveView {
        LiveViewArguments { count, timeout }.start_at(50 * MS, 50 * MS)
    }

    #[test]
    fn view_ends_with_its_count_or_timeout() {
        let mut view = view(Some(2), Some(10));
        assert!(!view.count_line() && view.count_line() && !view.count_line());
        assert!(!view.has_timed_out(59 * MS) && view.has_timed_out(60 * MS));
        view.receive(55 * MS);
        assert!(!view.has_timed_out(64 * MS) && view.has_timed_out(65 * MS));
        assert_eq!(view.seconds(1_550 * MS), 1.5);
    }

    #[test]
    fn user_ends_a_view_without_count() {
        let stopped = || Err(Failure::Incomplete("stopped".to_owned()));
        assert!(matches!(view(None, None).after_cycle(stopped()), Ok(None)));
        assert!(matches!(view(Some(1), None).after_cycle(stopped()), Err(Failure::Incomplete(_))));
        assert!(matches!(view(None, None).after_cycle(Ok(7)), Ok(Some(7))));
        assert!(!view(None, None).has_timed_out(u64::MAX));
    }
}
