//! `ecan node lss set-id`, `set-bitrate`, `store`, `select` and `release`: node-ID and bit rate of an LSS slave.

use std::str::FromStr;
use std::time::Duration;

use clap::Args;
use ecan_canopen::{LssAddress, LssBitRate, LssCommand, LssResult, NmtState, NodeId, object};
use ecan_tool_support::command_line::options::{milliseconds, parse_bit_rate};
use serde::Serialize;

use super::lss_client::{JsonAddress, LssClient, LssOptions, SlaveSelection, parse_node};
use crate::commands::node::node_target::NodeTarget;
use crate::context::{Context, Failure, Result, note};
use crate::output::confirm;

/// A node-ID, or `none`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct NewId(Option<NodeId>);

impl FromStr for NewId {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        match text {
            "none" => Ok(Self(None)),
            text => parse_node(text)
                .map(|node| Self(Some(node)))
                .map_err(|error| format!("{error}, or none")),
        }
    }
}

#[derive(Debug, Args)]
pub struct SetIdArguments {
    /// New node-ID, 1 to 127, or none
    id: NewId,
    #[command(flatten)]
    common: Common,
}

#[derive(Debug, Args)]
pub struct SetBitRateArguments {
    /// New bit rate of CiA 305 in bit/s: 10k to 1M
    #[arg(value_name = "BITRATE", value_parser = bit_rate)]
    rate: LssBitRate,
    /// Activate it after this time; the channel needs the new bit rate then
    #[arg(long, value_name = "TIME", value_parser = milliseconds::<u16>(1..=10_000))]
    activate: Option<u16>,
    #[command(flatten)]
    common: Common,
}

#[derive(Debug, Args)]
pub struct StoreArguments {
    #[command(flatten)]
    selection: SlaveSelection,
    #[command(flatten)]
    lss: LssOptions,
}

#[derive(Debug, Args)]
struct Common {
    #[command(flatten)]
    selection: SlaveSelection,
    /// Store the configuration in the slave
    #[arg(long)]
    store: bool,
    /// Configure without asking
    #[arg(long)]
    yes: bool,
    #[command(flatten)]
    lss: LssOptions,
}

fn bit_rate(text: &str) -> Result<LssBitRate, String> {
    let rate = parse_bit_rate(text).ok().and_then(LssBitRate::from_bit_per_s);
    rate.ok_or_else(|| {
        let rates = LssBitRate::ALL.iter().filter_map(|rate| rate.bit_per_s());
        let rates: Vec<_> = rates.map(|rate| rate.to_string()).collect();
        format!("allowed: {}", rates.join(", "))
    })
}

#[derive(Debug, Serialize)]
struct Configured {
    slave: usize,
    channel: u8,
    #[serde(flatten)]
    address: JsonAddress,
    /// Node-ID before.
    node_before: Option<u8>,
    node: Option<u8>,
    bitrate: Option<u32>,
    is_stored: bool,
    /// The slave has booted with its first node-ID.
    has_booted: bool,
}

/// Longest time for the boot-up message of a slave that got its first node-ID.
const BOOT_UP: Duration = Duration::from_secs(3);

pub fn set_id(arguments: &SetIdArguments, context: &Context) -> Result {
    let Common { selection, store, yes, lss } = &arguments.common;
    let context = &context.on_stderr(lss.options.capture.is_on_output());
    let NewId(new) = arguments.id;
    let name = new.map_or_else(|| "no node-ID".to_owned(), |node| format!("node-ID {node}"));
    confirm(
        *yes,
        &format!("configuring {name}"),
        format_args!("Configure {name} in a slave of can{}. Continue?", lss.channel),
        "nothing was configured",
    )?;
    let client = LssClient::start(lss, None, context)?;
    let slave = client.slave();
    let configured = client.run(|client| {
        if let Some(new) = new.filter(|node| Some(*node) != selection.node()) {
            check_free(client, new)?;
        }
        let (address, before) = select_one(*selection, client)?;
        let result = configure(client, LssCommand::ConfigureNodeId(new), *store);
        let has_booted = match (&result, before, new) {
            (Ok(()), None, Some(new)) => release_and_await(client, new)?,
            _ => {
                client.release()?;
                false
            }
        };
        result?;
        Ok(Configured {
            slave,
            channel: lss.channel,
            address: address.into(),
            node_before: before.map(NodeId::get),
            node: new.map(NodeId::get),
            bitrate: None,
            is_stored: *store,
            has_booted,
        })
    })?;
    if let (Some(before), true) = (configured.node_before, configured.node.is_some()) {
        note(format_args!(
            "# the slave uses {name} after a reset: `ecan node nmt reset-comm --node {before}`"
        ));
    } else if configured.node.is_some() && !configured.has_booted {
        print(&configured, context)?;
        return Err(Failure::Incomplete(format!(
            "{name} was configured, but the slave sent no boot-up message; see `ecan node scan`"
        )));
    }
    print(&configured, context)
}

/// Rejects a node-ID that a node answers to.
fn check_free(client: &mut LssClient, node: NodeId) -> Result {
    let channel = client.node.target().channel;
    client.node.set_target(NodeTarget { channel, node });
    match client.node.try_upload(object::DEVICE_TYPE, 0)? {
        Err(ecan_canopen::SdoFault::TimedOut { .. }) => Ok(()),
        _ => Err(Failure::Rejected(format!(
            "node-ID {node} is in use on can{channel}; choose another one, see `ecan node scan`"
        ))),
    }
}

/// Configures the selected slave.
fn configure(client: &mut LssClient, command: LssCommand, is_stored: bool) -> Result {
    client.command(command)?;
    if is_stored {
        client.command(LssCommand::Store)?;
    }
    Ok(())
}

/// Switches the slave to the waiting state, and waits for its boot-up message.
fn release_and_await(client: &mut LssClient, node: NodeId) -> Result<bool> {
    let channel = client.node.target().channel;
    client.node.set_target(NodeTarget { channel, node });
    client.node.forget_state();
    client.release()?;
    client.node.run_for(BOOT_UP, |observed| {
        matches!(observed.state(), Some(NmtState::Initialising | NmtState::PreOperational))
    })
}

pub fn set_bit_rate(arguments: &SetBitRateArguments, context: &Context) -> Result {
    let Common { selection, store, yes, lss } = &arguments.common;
    let context = &context.on_stderr(lss.options.capture.is_on_output());
    let rate = arguments.rate;
    if arguments.activate.is_some()
        && let Some(connection) = crate::context::open(context.global, context.global.master())?
    {
        return Err(Failure::Usage(format!(
            "--activate needs the gateways alone: {} has configured the bit rate of can{}; remove \
             --activate, or end that program",
            connection.program(),
            lss.channel
        )));
    }
    confirm(
        *yes,
        &format!("configuring {rate}"),
        format_args!("Configure {rate} in a slave of can{}. Continue?", lss.channel),
        "nothing was configured",
    )?;
    let client = LssClient::start(lss, None, context)?;
    let slave = client.slave();
    let configured = client.run(|client| {
        let (address, node) = select_one(*selection, client)?;
        let result = configure(client, LssCommand::ConfigureBitRate(rate), *store);
        match (&result, arguments.activate) {
            (Ok(_), Some(delay_ms)) => {
                client.command(LssCommand::ActivateBitRate { delay_ms })?;
            }
            _ => client.release()?,
        }
        result?;
        Ok(Configured {
            slave,
            channel: lss.channel,
            address: address.into(),
            node_before: node.map(NodeId::get),
            node: node.map(NodeId::get),
            bitrate: rate.bit_per_s(),
            is_stored: *store,
            has_booted: false,
        })
    })?;
    match arguments.activate {
        Some(_) => note(format_args!(
            "# the slave is in the configuration state at {rate}: `ecan node lss release --bitrate {}`",
            rate.bit_per_s().unwrap_or(0)
        )),
        None => note("# the slave uses the bit rate after the next power cycle, if it is stored"),
    }
    print(&configured, context)
}

pub fn store(arguments: &StoreArguments, context: &Context) -> Result {
    let context = &context.on_stderr(arguments.lss.options.capture.is_on_output());
    let client = LssClient::start(&arguments.lss, None, context)?;
    let slave = client.slave();
    let configured = client.run(|client| {
        let (address, node) = select_one(arguments.selection, client)?;
        let result = configure(client, LssCommand::Store, false);
        client.release()?;
        result?;
        Ok(Configured {
            slave,
            channel: arguments.lss.channel,
            address: address.into(),
            node_before: node.map(NodeId::get),
            node: node.map(NodeId::get),
            bitrate: None,
            is_stored: true,
            has_booted: false,
        })
    })?;
    print(&configured, context)
}

fn print(configured: &Configured, context: &Context) -> Result {
    let Configured { slave, channel, address, node, bitrate, is_stored, has_booted, .. } =
        configured;
    context.output.data(configured, |out| {
        let mut parts = vec![match node {
            Some(node) => format!("node-ID {node}"),
            None => "no node-ID".to_owned(),
        }];
        parts.extend(bitrate.map(|bitrate| format!("{bitrate} bit/s")));
        parts.extend(is_stored.then(|| "stored".to_owned()));
        parts.extend(has_booted.then(|| "booted".to_owned()));
        writeln!(out, "slave {slave} can{channel}: {address}: {}", parts.join(", "))
    })
}

#[derive(Debug, Args)]
pub struct SelectArguments {
    #[command(flatten)]
    selection: SlaveSelection,
    #[command(flatten)]
    lss: LssOptions,
}

#[derive(Debug, Args)]
pub struct ReleaseArguments {
    #[command(flatten)]
    lss: LssOptions,
}

#[derive(Debug, Serialize)]
struct Selected {
    slave: usize,
    channel: u8,
    #[serde(flatten)]
    address: JsonAddress,
    /// `None` for a slave without node-ID.
    node: Option<u8>,
}

/// Selects a slave, and reads its address and node-ID.
///
/// # Errors
/// Another slave responds, too, or in its place; then all are in the waiting state again.
pub fn select_one(
    selection: SlaveSelection,
    client: &mut LssClient,
) -> Result<(LssAddress, Option<NodeId>)> {
    selection.select(client)?;
    let before = client.late_strays()?;
    let (address, node) = inquire(client)?;
    let reason = match selection.node() {
        _ if client.late_strays()? > before => {
            "several slaves respond; select one by --address, or separate slaves with equal addresses"
        }
        Some(expected) if node != Some(expected) => {
            "another slave has the same LSS address; separate the slaves"
        }
        _ => return Ok((address, node)),
    };
    client.release()?;
    Err(Failure::Rejected(format!("LSS on can{}: {reason}", client.node.target().channel)))
}

fn inquire(client: &mut LssClient) -> Result<(LssAddress, Option<NodeId>)> {
    let address = match client.command(LssCommand::InquireAddress)? {
        LssResult::Address(address) => address,
        _ => LssAddress::default(),
    };
    let node = match client.command(LssCommand::InquireNodeId)? {
        LssResult::NodeId(node) => node,
        _ => None,
    };
    Ok((address, node))
}

pub fn select(arguments: &SelectArguments, context: &Context) -> Result {
    let context = &context.on_stderr(arguments.lss.options.capture.is_on_output());
    let client = LssClient::start(&arguments.lss, None, context)?;
    let (slave, channel) = (client.slave(), arguments.lss.channel);
    let (address, node) = client.run(|client| select_one(arguments.selection, client))?;
    let selected =
        Selected { slave, channel, address: address.into(), node: node.map(NodeId::get) };
    context.output.data(&selected, |out| {
        let node = node.map_or_else(|| "no node-ID".to_owned(), |node| format!("node-ID {node}"));
        writeln!(out, "slave {slave} can{channel}: {address}: {node}, configuration state")
    })
}

pub fn release(arguments: &ReleaseArguments, context: &Context) -> Result {
    let context = &context.on_stderr(arguments.lss.options.capture.is_on_output());
    let client = LssClient::start(&arguments.lss, None, context)?;
    let (slave, channel) = (client.slave(), arguments.lss.channel);
    client.run(LssClient::release)?;
    context.output.data(&serde_json::json!({ "slave": slave, "channel": channel }), |out| {
        writeln!(out, "slave {slave} can{channel}: all slaves switched to the waiting state")
    })
}
