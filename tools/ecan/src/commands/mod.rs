//! The commands, a file each.

pub mod bridge;
pub mod caps;
pub mod dump;
pub mod generate;
pub mod info;
pub mod man;
pub mod replay;
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
    /// Send frames made up, as cangen does
    #[command(name = "gen", after_help = generate::EXAMPLES)]
    Gen(generate::GenArguments),
    /// Send the frames of a candump log at their times
    #[command(after_help = replay::EXAMPLES)]
    Replay(replay::ReplayArguments),
    /// Give a channel to other programs: slcan over TCP and on a terminal, socketcand over TCP
    #[command(after_help = bridge::EXAMPLES)]
    Bridge(bridge::BridgeArguments),
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
