pub mod axis;
pub mod bridge;
mod bundle;
pub mod config;
pub mod diag;
pub mod doctor;
pub mod dump;
pub mod filter;
pub mod firmware;
pub mod generate;
pub mod info;
pub mod monitor;
pub mod new;
pub mod node;
pub mod pins;
pub mod plan;
pub mod probe;
pub mod reboot;
pub mod reg;
pub mod replay;
mod saved_config;
pub mod scan;
pub mod sdo;
pub mod selftest;
pub mod send;
pub mod serve;
pub mod sim;
#[cfg(feature = "zenoh")]
pub mod zenoh;

use std::path::PathBuf;

use clap::Subcommand;
use clap_complete::Shell;

/// Command to run.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// List the slaves of the bus: state, identity, versions, serial number
    Scan,
    /// Show a gateway: identity, versions, state, profiles, channels
    Info(info::InfoArguments),
    /// Show the capabilities of a gateway (0xF000, manual 13.8)
    Caps,
    /// Check, apply, compare, save and export the configuration of gateways
    Config(config::ConfigArguments),
    /// Read, write and list objects by number or by the names of the manual
    Sdo(sdo::SdoArguments),
    /// Diagnose a gateway: problems, causes and remedies (manual 16)
    Diag(diag::DiagArguments),
    /// Check this host: library, kernel module, network interface, real time
    Doctor(doctor::DoctorArguments),
    /// Read and write registers of a CAN controller (manual 13.6)
    Reg(reg::RegArguments),
    /// List and change the acceptance filters of a channel (manual 13.4)
    Filter(filter::FilterArguments),
    /// Show or set the connector of each CAN channel (manual 13.3)
    Pins(pins::PinsArguments),
    /// Restart a gateway (manual 13.3)
    Reboot(reboot::RebootArguments),
    /// Estimate the load of a configuration, offline
    Plan(plan::PlanArguments),
    Firmware(firmware::FirmwareArguments),
    /// Print or log the frames of CAN channels, like candump
    #[command(after_help = dump::EXAMPLES)]
    Dump(dump::DumpArguments),
    /// Send frames, like cansend, and wait for their transmission
    #[command(after_help = send::EXAMPLES)]
    Send(send::SendArguments),
    /// Send generated frames, like cangen
    #[command(name = "gen", after_help = generate::EXAMPLES)]
    Gen(generate::GenArguments),
    /// Send the frames of a recording at their recorded times
    #[command(after_help = replay::EXAMPLES)]
    Replay(replay::ReplayArguments),
    /// Show gateways, CAN IDs, axes and cycle in full-screen mode
    #[command(after_help = monitor::EXAMPLES)]
    Monitor(monitor::MonitorArguments),
    /// Access CANopen nodes: scan, objects, NMT, PDOs, errors
    #[command(after_help = node::EXAMPLES)]
    Node(node::NodeArguments),
    /// Commission a CiA 402 axis: status, enable, jog, move, home, stop, tune
    #[command(after_help = axis::EXAMPLES)]
    Axis(axis::AxisArguments),
    /// Connect other programs to channels: slcan, socketcand or SocketCAN
    #[command(after_help = bridge::EXAMPLES)]
    Bridge(bridge::BridgeArguments),
    /// Hold the master and serve the bus to other programs
    #[command(after_help = serve::EXAMPLES)]
    Serve(serve::ServeArguments),
    /// Inject faults into the simulated machine of a service, and show its state
    #[command(after_help = sim::EXAMPLES)]
    Sim(sim::SimArguments),
    /// Publish a service to other hosts through Zenoh
    #[cfg(feature = "zenoh")]
    #[command(after_help = zenoh::EXAMPLES)]
    Zenoh(zenoh::ZenohArguments),
    /// Decide by experiments what the manual leaves open about a gateway
    #[command(after_help = probe::EXAMPLES)]
    Probe(probe::ProbeArguments),
    /// Test gateways in production: identity, channels by loopback and wiring
    #[command(after_help = selftest::EXAMPLES)]
    Selftest(selftest::SelftestArguments),
    /// Write a project to start from
    #[command(after_help = new::EXAMPLES)]
    New(new::NewArguments),
    /// Print a completion script for a shell
    Completions {
        /// Shell
        shell: Shell,
    },
    /// Write the manual pages
    Man {
        /// Directory for the pages
        directory: PathBuf,
    },
}
