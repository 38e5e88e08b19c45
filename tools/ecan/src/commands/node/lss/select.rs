//! `ecan node lss select` and `release`.

use clap::Args;
use ecan_canopen::{LssAddress, LssCommand, LssResult, NodeId};
use serde::Serialize;

use crate::context::{Context, Failure, Result};

use super::lss_client::{JsonAddress, LssClient, LssOptions};
use super::slave_selection::SlaveSelection;

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
        let node = node.map_or_else(|| "no node-ID".to_owned(), |it| format!("node-ID {it}"));
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
