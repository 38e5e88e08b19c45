//! The commands, a file each.

pub mod caps;
pub mod dump;
pub mod info;
pub mod man;
pub mod scan;
pub mod sdo;
pub mod send;

use std::path::PathBuf;

use clap::Subcommand;
use clap_complete::Shell;

/// What to do.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// List the slaves of the bus: state, identity, versions, serial number
    Scan,
    /// Tell about one gateway: identity, versions, state, profiles, channels
    Info,
    /// Tell in words what a gateway can do (0xF000, manual 13.8)
    Caps,
    /// Read, write and list objects, by number or by the manual's names
    Sdo(sdo::SdoArguments),
    /// Show or log the frames of CAN channels, as candump does
    #[command(after_help = dump::EXAMPLES)]
    Dump(dump::DumpArguments),
    /// Send frames, as cansend does, and wait until they have left
    #[command(after_help = send::EXAMPLES)]
    Send(send::SendArguments),
    /// Print a completion script for a shell
    Completions {
        /// Which shell
        shell: Shell,
    },
    /// Write the manual pages
    Man {
        /// Directory for the pages
        directory: PathBuf,
    },
}
