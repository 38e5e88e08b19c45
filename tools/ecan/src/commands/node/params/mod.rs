//! `ecan node params`: the configuration of a node as a device configuration file (DCF, CiA 306-1).

mod restore;
mod save;

use clap::{Args, Subcommand};

use crate::context::{Context, Result};

pub const NOTES: &str = "\
A DCF is the device file (EDS) of a node with its values. `save` reads every readable and writable
object of the device file; `diff` compares; `restore` writes the values in an order that devices
accept, each PDO disabled while it changes, and reads them again.
  ecan node params save left.dcf --node 5 --eds drive.eds
  ecan node params diff left.dcf --node 5
  ecan node params restore left.dcf --node 5 --store

Commands are left out: controlword, mode, targets, offsets and outputs of CiA 402, 0x1003, 0x1010,
0x1011, and 0x1F50 to 0x1F5F (program download).

restore needs a drive that is off, the identity of the file, and its node-ID: the values have its
COB-IDs. For another node-ID use --application, which leaves out 0x1000 to 0x1FFF. Many nodes accept
PDO mappings only in the state pre-operational: `ecan node nmt preop` first.

Exit status 1 if a value differs; 5 if a value was not restored.";

#[derive(Debug, Args)]
pub struct ParamsArguments {
    #[command(subcommand)]
    action: Action,
}

#[derive(Debug, Subcommand)]
enum Action {
    /// Read the values of a node into a new DCF
    Save(save::SaveArguments),
    /// Compare the values of a DCF with those of a node
    Diff(restore::DiffArguments),
    /// Write the values of a DCF to a node, and read them again
    Restore(restore::RestoreArguments),
}

pub fn run(arguments: &ParamsArguments, context: &Context) -> Result {
    match &arguments.action {
        Action::Save(arguments) => save::run(arguments, context),
        Action::Diff(arguments) => restore::run_diff(arguments, context),
        Action::Restore(arguments) => restore::run(arguments, context),
    }
}
