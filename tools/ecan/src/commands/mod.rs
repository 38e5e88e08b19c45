//! The commands, a file each.

pub mod bridge;
pub mod caps;
pub mod config;
pub mod diag;
pub mod doctor;
pub mod dump;
pub mod filter;
pub mod firmware;
pub mod generate;
pub mod info;
pub mod man;
pub mod monitor;
pub mod pins;
pub mod plan;
pub mod reboot;
pub mod reg;
pub mod replay;
pub mod scan;
pub mod sdo;
pub mod selftest;
pub mod send;

use std::path::PathBuf;

use clap::Subcommand;
use clap_complete::Shell;

/// What to do.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// List the slaves of the bus: state, identity, versions, serial number
    Scan,
    /// Tell about a gateway: identity, versions, state, profiles, channels
    Info(info::InfoArguments),
    /// Tell in words what a gateway can do (0xF000, manual 13.8)
    Caps,
    /// Check, apply, compare, save and export the configuration of gateways
    Config(config::ConfigArguments),
    /// Read, write and list objects, by number or by the manual's names
    Sdo(sdo::SdoArguments),
    /// Look for what is wrong with a gateway, with causes and remedies (manual 16)
    Diag(diag::DiagArguments),
    /// Look for what is wrong with this host: library, module, interface, real time
    Doctor(doctor::DoctorArguments),
    /// Read and write registers of a CAN controller (manual 13.6)
    Reg(reg::RegArguments),
    /// List and change the acceptance filters of a channel (manual 13.4)
    Filter(filter::FilterArguments),
    /// Show or set which connector each CAN channel is at (manual 13.3)
    Pins(pins::PinsArguments),
    /// Restart a gateway (manual 13.3)
    Reboot(reboot::RebootArguments),
    /// Tell what a configuration costs, before it touches a bus
    Plan(plan::PlanArguments),
    Firmware(firmware::FirmwareArguments),
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
    /// Watch gateways, channels and the cycle on the whole terminal
    #[command(after_help = monitor::EXAMPLES)]
    Monitor(monitor::MonitorArguments),
    /// Give a channel to other programs, by slcan, socketcand or SocketCAN
    #[command(after_help = bridge::EXAMPLES)]
    Bridge(bridge::BridgeArguments),
    /// Test gateways on the production line: identity, every channel by loopback and by wire
    #[command(after_help = selftest::EXAMPLES)]
    Selftest(selftest::SelftestArguments),
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
