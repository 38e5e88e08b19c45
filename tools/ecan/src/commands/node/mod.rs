//! `ecan node`: one CANopen node through a gateway (CiA 301).

mod bit_rate_search;
mod emcy;
mod info;
mod lss;
mod nmt;
pub mod node_client;
pub mod node_link;
pub mod node_target;
mod object_value;
mod objects;
mod params;
mod pdo;
pub mod scan;
mod sdo;

use clap::{Args, Subcommand};

use crate::context::{Context, Result};

pub const EXAMPLES: &str = "\
Examples:
  ecan node scan                                      nodes of all channels
  ecan node info --node 5                             node 5 on channel 0
  ecan node info --node gripper --config machine.toml the node with this name in the file
  ecan node sdo read --node 1.5 0x6064                node 5 on channel 1
  ecan node sdo write --node 5 0x1017 500             an object of CiA 301 or CiA 402
  ecan node sdo write --node 5 --type i16 0x2001:3 -7 an object of the manufacturer
  ecan node sdo read --node 5 --eds drive.eds 'motor/pole pairs'
  ecan node nmt preop --node 5                        confirmed by the state of the node
  ecan node pdo --node 5 --watch                      mapping, then the values on the bus
  ecan node params save left.dcf --node 5 --eds drive.eds
  ecan node lss scan                                  slaves without node-ID
  ecan node emcy --node 5                             error history

Directly the gateway is configured and no application runs; through `ecan serve` or an application
(--via) its cycle continues. Two SDO clients of one node disturb each other: do not use `sdo`,
`info`, `pdo` and `emcy` for a node that an application is configuring.

What can move a motor asks for confirmation or needs --yes: NMT start and the resets, and writing
controlword, mode, targets, offsets and outputs of CiA 402.";

#[derive(Debug, Args)]
pub struct NodeArguments {
    #[command(subcommand)]
    action: Action,
}

#[derive(Debug, Subcommand)]
enum Action {
    /// Find the nodes of all channels by SDO and by their heartbeats
    #[command(after_help = scan::NOTES)]
    Scan(scan::ScanArguments),
    /// Show a node: type, identity, state, heartbeat, PDOs, drive
    Info(info::InfoArguments),
    /// Read, write and list objects of a node by number or name
    Sdo(sdo::SdoArguments),
    /// Change the NMT state of a node, and wait for its confirmation
    #[command(after_help = nmt::NOTES)]
    Nmt(nmt::NmtArguments),
    /// Show the PDOs of a node: communication, mapping, live values
    Pdo(pdo::PdoArguments),
    /// Save, compare and restore the configuration of a node (DCF)
    #[command(after_help = params::NOTES)]
    Params(params::ParamsArguments),
    /// Find slaves by LSS, and configure their node-IDs and bit rates (CiA 305)
    #[command(after_help = lss::NOTES)]
    Lss(lss::LssArguments),
    /// Show the errors of a node: history (0x1003) and emergency messages
    Emcy(emcy::EmcyArguments),
}

pub fn run(arguments: &NodeArguments, context: &Context) -> Result {
    match &arguments.action {
        Action::Scan(arguments) => scan::run(arguments, context),
        Action::Info(arguments) => info::run(arguments, context),
        Action::Sdo(arguments) => sdo::run(arguments, context),
        Action::Nmt(arguments) => nmt::run(arguments, context),
        Action::Pdo(arguments) => pdo::run(arguments, context),
        Action::Params(arguments) => params::run(arguments, context),
        Action::Lss(arguments) => lss::run(arguments, context),
        Action::Emcy(arguments) => emcy::run(arguments, context),
    }
}
