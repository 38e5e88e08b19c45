//! `ecan serve`: holds the master, keeps the gateways ready and serves the bus to other programs.

mod cycle;
mod simulation;

use std::path::PathBuf;
use std::thread::sleep;
use std::time::Duration;

use clap::Args;
use ecan_command_line::interrupt::Interrupt;
use ecan_service::{Control, Service, ServiceConfig};
use ecan_sim::{Backend, ClockKind};

use crate::context::{Context, Failure, Result, note};
use crate::frames::{GatewayOptions, Settings};
use crate::via::default_paths;

use cycle::GatewayCycle;
use simulation::SimulationMethods;

pub const EXAMPLES: &str = "\
Examples:
  ecan serve --config cell.toml                the gateways of a file, clients of this user may control
  ecan serve --bitrate 1000000 --read-only     all gateways of the bus, clients only read
  ecan serve --idle                            no cycle: SDO transfers only
  ecan --ecrt sim:drives serve                 a simulated machine that stays alive

Clients: ecan --via, docs/SERVICE.md. A fault that may pass (no link, a slave that does not answer) does not end the
command: it tries again.";

/// Interval of looking for signals without a cycle.
const POLL: Duration = Duration::from_millis(50);
/// Pauses before further attempts to start the gateways.
const PAUSES_S: [u64; 4] = [1, 2, 5, 10];

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
    let config = service_config(arguments, &backend, master)?;
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
    let mut attempts = 0;
    while !interrupt.is_set() {
        let started = GatewayCycle::start(&backend, &settings, arguments, context);
        let ended = started.and_then(|mut cycle| {
            service.attach(cycle.port_mut());
            let ended = cycle.run(&interrupt);
            attempts = if cycle.has_been_ready() { 0 } else { attempts };
            ended
        });
        service.detach();
        match ended {
            Ok(()) => {}
            Err(error) if is_lasting(&error) => return Err(error),
            Err(error) => {
                let pause_s = PAUSES_S.get(attempts).or(PAUSES_S.last()).copied().unwrap_or(1);
                attempts += 1;
                note(format_args!("serve: {error}; next attempt in {pause_s} s"));
                wait(Duration::from_secs(pause_s), &interrupt);
            }
        }
    }
    Ok(())
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
    let mut config = ServiceConfig::new(path)
        .with_control(control)
        .with_name("ecan serve", env!("CARGO_PKG_VERSION"));
    (config.group, config.max_clients) = (arguments.group.clone(), arguments.max_clients.into());
    if let Some(simulation) = &backend.simulation {
        config = config.with_extension(SimulationMethods::new(simulation));
    }
    Ok(config)
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

/// Returns whether another attempt would end with the same error.
fn is_lasting(error: &Failure) -> bool {
    !matches!(
        error,
        Failure::Master(_)
            | Failure::Slave(_)
            | Failure::Device(_)
            | Failure::Rejected(_)
            | Failure::NotReady { .. }
    )
}

fn wait(duration: Duration, interrupt: &Interrupt) {
    let mut left = duration;
    while !left.is_zero() && !interrupt.is_set() {
        let step = left.min(POLL);
        sleep(step);
        left -= step;
    }
}
