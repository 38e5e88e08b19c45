//! `ecan serve`: holds the master, keeps the gateways ready and serves the bus to other programs.

mod cycle;
mod daemon;
mod reconfigure;
mod simulation;

use std::path::PathBuf;
use std::thread::sleep;
use std::time::Duration;

use clap::Args;
use ecan_command_line::interrupt::Interrupt;
use ecan_service::{Control, Service, ServiceConfig};
use ecan_service_client::Hello;
use ecan_sim::{Backend, ClockKind};

use crate::context::{Context, Failure, Result, note};
use crate::frames::{GatewayOptions, Settings};
use crate::via::default_paths;

pub use cycle::requirements;
use daemon::Daemon;
use reconfigure::ReconfigureMethod;
use simulation::SimulationMethods;

pub const EXAMPLES: &str = "\
Examples:
  ecan serve --config cell.toml                the gateways of a file, clients of this user may control
  ecan serve --bitrate 1000000 --read-only     all gateways of the bus, clients only read
  ecan serve --idle                            no cycle: SDO transfers only
  ecan --ecrt sim:drives serve                 a simulated machine that stays alive

Clients: ecan --via, docs/SERVICE.md. A fault that may pass (no link, a slave that does not answer) does not end the
command: it tries again.";

/// Name of the program in its service.
const NAME: &str = "ecan serve";
/// Interval of looking for signals without a cycle.
const POLL: Duration = Duration::from_millis(50);

#[derive(Debug, Args)]
pub struct ServeArguments {
    /// Socket for clients [default: /run/ecan/master<N>.sock for root, otherwise
    /// $XDG_RUNTIME_DIR/ecan/master<N>.sock]
    #[arg(long, value_name = "PATH")]
    socket: Option<PathBuf>,
    /// Group of the socket [default: of this process]
    #[arg(long, value_name = "GROUP")]
    group: Option<String>,
    /// Reject requests that send frames or change something
    #[arg(long)]
    read_only: bool,
    /// Permit control to the members of a group [default: to this user and root]
    #[arg(long, value_name = "GROUP", conflicts_with = "read_only")]
    control_group: Option<String>,
    /// Maximum number of clients
    #[arg(long, value_name = "COUNT", default_value_t = 64,
          value_parser = clap::value_parser!(u16).range(1..=1000))]
    max_clients: u16,
    /// Run no cycle; serve the state of the bus and SDO transfers only
    #[arg(long, conflicts_with_all = ["config", "bitrate"])]
    idle: bool,
    #[command(flatten)]
    options: GatewayOptions,
}

pub fn run(arguments: &ServeArguments, context: &Context) -> Result {
    context.global.without_slave("it serves all gateways of the bus or of the file")?;
    let settings = Settings::of(&arguments.options)?;
    let interrupt = Interrupt::install()?;
    let master = settings.master(context.global);
    let backend = context.backend(&context.setting()?, ClockKind::Real)?;
    let mut config = service_config(arguments, &backend, master)?;
    let (reconfigure, requests) = ReconfigureMethod::new(&backend, master, context.global);
    if !arguments.idle {
        config = config.with_extension(reconfigure);
    }
    let service = Service::of_bus(&backend.ecrt, master, config);
    let service = service.map_err(|error| Failure::Host(error.to_string()))?;
    let access = match (arguments.read_only, &arguments.control_group) {
        (true, _) => "read-only".to_owned(),
        (false, Some(group)) => format!("control for group {group}"),
        (false, None) => "control for this user".to_owned(),
    };
    note(format_args!("serving master {master} at {}, {access}", service.path().display()));
    if arguments.idle {
        return idle(&backend, &interrupt);
    }
    let daemon = Daemon {
        backend: &backend,
        settings,
        arguments,
        context,
        service: &service,
        interrupt: &interrupt,
        requests,
        last: None,
    };
    daemon.run()
}

fn service_config(
    arguments: &ServeArguments,
    backend: &Backend,
    master: u32,
) -> Result<ServiceConfig> {
    let path = match &arguments.socket {
        Some(path) => path.clone(),
        None => default_socket(master)?,
    };
    let control = match &arguments.control_group {
        _ if arguments.read_only => Control::Nobody,
        Some(group) => Control::Group(group.clone()),
        None => Control::Owner,
    };
    let mut config =
        ServiceConfig::new(path).with_control(control).with_name(NAME, env!("CARGO_PKG_VERSION"));
    (config.group, config.max_clients) = (arguments.group.clone(), arguments.max_clients.into());
    if let Some(simulation) = &backend.simulation {
        config = config.with_extension(SimulationMethods::new(simulation));
    }
    Ok(config)
}

/// Returns whether a service is `ecan serve` with its [`requirements`].
pub fn keeps_gateways(hello: &Hello) -> bool {
    hello.server == NAME && hello.cycle_ns.is_some()
}

fn default_socket(master: u32) -> Result<PathBuf> {
    let is_root = rustix::process::geteuid().is_root();
    let path = default_paths(master).into_iter().nth(usize::from(!is_root));
    path.ok_or_else(|| Failure::Usage("XDG_RUNTIME_DIR is not set; set --socket".to_owned()))
}

/// Serves a bus without a cycle. A simulation needs a thread that lets its time pass.
fn idle(backend: &Backend, interrupt: &Interrupt) -> Result {
    let runner = backend.simulation.as_ref().map(ecan_sim::Simulation::keep_running);
    let _runner = runner.transpose().map_err(|error| Failure::Host(error.to_string()))?;
    while !interrupt.is_set() {
        sleep(POLL);
    }
    Ok(())
}
