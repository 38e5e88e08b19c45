//! `ecan node lss`: layer setting services (CiA 305).

mod configure;
mod lss_client;
mod search;

use clap::{Args, Subcommand};

use crate::context::{Context, Result};

pub const NOTES: &str = "\
A slave has an LSS address: vendor-ID, product code, revision number and serial number of 0x1018. A
slave without node-ID takes part in LSS only; `scan` finds all of them, one after the other.
  ecan node lss scan
  ecan node lss set-id 5 --address 0x53494D00:402:0x10000:77 --store
  ecan node lss set-id 7 --node 5                     change a node-ID
  ecan node lss set-bitrate 500000 --only --store     the only LSS slave of the channel

set-id, set-bitrate and store select a slave, configure it and switch it back to the waiting state. A
slave without node-ID then boots with the new one; another one uses it after `ecan node nmt
reset-comm`, until a power cycle unless it was stored. A bit rate is used after the next power cycle,
or is activated by --activate in all slaves that are in the configuration state.

select leaves a slave in the configuration state, in which it takes no part in a fastscan; release ends
that for all slaves.

Exit status 1 if no slave is found.";

#[derive(Debug, Args)]
pub struct LssArguments {
    #[command(subcommand)]
    action: Action,
}

#[derive(Debug, Subcommand)]
enum Action {
    /// Find the LSS addresses of all slaves without node-ID (fastscan)
    Scan(search::ScanArguments),
    /// Ask whether there are slaves of a product, or slaves without node-ID
    Identify(search::IdentifyArguments),
    /// Select a slave, and show its LSS address and node-ID
    Select(configure::SelectArguments),
    /// Configure the node-ID of a slave
    SetId(configure::SetIdArguments),
    /// Configure the bit rate of a slave
    SetBitrate(configure::SetBitRateArguments),
    /// Store node-ID and bit rate in a slave
    Store(configure::StoreArguments),
    /// Switch all slaves to the waiting state
    Release(configure::ReleaseArguments),
}

pub fn run(arguments: &LssArguments, context: &Context) -> Result {
    match &arguments.action {
        Action::Scan(arguments) => search::scan(arguments, context),
        Action::Identify(arguments) => search::identify(arguments, context),
        Action::Select(arguments) => configure::select(arguments, context),
        Action::SetId(arguments) => configure::set_id(arguments, context),
        Action::SetBitrate(arguments) => configure::set_bit_rate(arguments, context),
        Action::Store(arguments) => configure::store(arguments, context),
        Action::Release(arguments) => configure::release(arguments, context),
    }
}
