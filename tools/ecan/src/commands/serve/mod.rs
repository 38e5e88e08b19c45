//! `ecan serve`: holds the master, keeps the gateways ready and serves the bus to other programs.

mod arguments;
mod daemon;
mod methods;
mod notification;

use std::os::unix::net::UnixListener;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::mpsc::channel;
use std::thread::sleep;

pub use arguments::ServeArguments;
use arguments::access_text;
use daemon::{Daemon, POLL};
use ecan_lite::config::ServiceSettings;
use ecan_protocol::text::Printable;
use ecan_service::client::Hello;
use ecan_service::server::{MetricsAddress, Service, ServiceConfig, ServiceError};
use ecan_sim::{Backend, ClockKind};
use ecan_tool_support::command_line::interrupt::Interrupt;
use listenfd::ListenFd;
use methods::{ReconfigureMethod, SimulationMethods};
use notification::{ActiveConfig, Event, Notifier, Reloader};

use crate::config_file;
use crate::context::{Context, Failure, Result, default_paths, note};
use crate::frames::Settings;

pub const EXAMPLES: &str = "\
Examples:
  ecan serve --config cell.toml                the gateways of a file, clients of this user may control
  ecan serve --bitrate 1M --read-only          all gateways of the bus, clients only read
  ecan serve --idle                            no cycle: SDO transfers only
  ecan serve --config cell.toml --metrics 127.0.0.1:9464    with metrics for Prometheus
  ecan --ecrt sim:drives serve                 a simulated machine that stays alive

Clients: ecan --via, docs/SERVICE.md. SIGHUP reads the file again. A fault that may pass (no link, a slave that does
not answer) does not end the command: it tries again.";

/// Name of the program in its service.
const NAME: &str = "ecan serve";

pub fn run(arguments: &ServeArguments, context: &Context) -> Result {
    context.global.without_slave("it serves all gateways of the bus or of the file")?;
    context.global.without_service("it needs the master itself")?;
    let settings = Settings::of(&arguments.options)?;
    let (notifier, events) = Notifier::new();
    let on_hang_up = notifier.clone();
    let interrupt = Interrupt::install_with_hang_up(move || on_hang_up.send(Event::HangUp))?;
    let master = settings.master(context.global);
    let path = arguments.options.setup.config.clone();
    let options = config_file::ecrt_options(path.as_deref())?;
    let backend = context.backend_with(&context.setting()?, ClockKind::Real, options)?;
    let (sender, commands) = channel();
    let of_file = path.as_deref().map(config_file::service).transpose()?.unwrap_or_default();
    let mut config = service_config(arguments, &of_file, &backend, master)?;
    if !arguments.idle {
        let sender = sender.clone();
        let method = ReconfigureMethod::new(&backend, master, context.global, sender);
        config = config.with_extension(method);
    }
    let access = access_text(&config.control);
    let service = Service::of_bus(&backend.ecrt, master, config);
    let service = Arc::new(service.map_err(|error| match error {
        ServiceError::RemoteMetrics(_) | ServiceError::PathTooLong { .. } => {
            Failure::Usage(error.to_string())
        }
        error => Failure::Host(error.to_string()),
    })?);
    match service.metrics_address() {
        Some(MetricsAddress::Tcp(address)) => {
            note(format_args!("metrics at http://{address}/metrics"))
        }
        Some(address) => note(format_args!("metrics at {address}")),
        None => {}
    }
    note(format_args!(
        "serving master {master} at {}, {access}",
        Printable(service.path().display())
    ));
    let active = ActiveConfig::default();
    let reloader = Reloader {
        path,
        global: context.global.clone(),
        access: arguments.access.clone(),
        last_access: arguments.access.with(&of_file),
        active: active.clone(),
        service: Arc::downgrade(&service),
        commands: sender,
    };
    let reporter = notifier.start(events, reloader)?;
    let ended = if arguments.idle {
        idle(&backend, &interrupt, &notifier)
    } else {
        let daemon = Daemon {
            backend: &backend,
            settings,
            arguments,
            context,
            service: &service,
            interrupt: &interrupt,
            commands,
            notifier: &notifier,
            active,
        };
        daemon.run()
    };
    notifier.end(&reporter);
    ended
}

fn service_config(
    arguments: &ServeArguments,
    of_file: &ServiceSettings,
    backend: &Backend,
    master: u32,
) -> Result<ServiceConfig> {
    let passed = passed_socket()?;
    let path = match (&passed, &arguments.socket) {
        (Some(_), Some(path)) => {
            return Err(Failure::Usage(format!(
                "--socket {} and a socket of the service manager exclude each other; remove --socket",
                Printable(path.display())
            )));
        }
        (Some(socket), None) => path_of(socket),
        (None, Some(path)) => path.clone(),
        (None, None) => default_socket(master)?,
    };
    let (control, max_clients) = arguments.access.with(of_file);
    let mut config =
        ServiceConfig::new(path).with_control(control).with_name(NAME, env!("CARGO_PKG_VERSION"));
    (config.group, config.max_clients) = (arguments.group.clone(), max_clients.into());
    (config.listener, config.metrics) = (passed, arguments.metrics());
    if let Some(simulation) = &backend.simulation {
        config = config.with_extension(SimulationMethods::new(simulation));
    }
    Ok(config)
}

/// The socket of the service manager (LISTEN_FDS); `None` without one.
fn passed_socket() -> Result<Option<UnixListener>> {
    let mut passed = ListenFd::from_env();
    let wrong = |error: &dyn std::fmt::Display| {
        Failure::Usage(format!(
            "the service manager must pass one listening Unix stream socket (ListenStream=): {error}"
        ))
    };
    match passed.len() {
        0 => Ok(None),
        1 => passed.take_unix_listener(0).map_err(|error| wrong(&error)),
        count => Err(wrong(&format_args!("it passes {count}"))),
    }
}

fn path_of(socket: &UnixListener) -> PathBuf {
    let address = socket.local_addr().ok();
    let path = address.as_ref().and_then(|address| address.as_pathname()).map(PathBuf::from);
    path.unwrap_or_else(|| "the socket of the service manager".into())
}

/// Returns whether a service is `ecan serve` with its requirements.
pub fn keeps_gateways(hello: &Hello) -> bool {
    hello.server == NAME && hello.cycle_ns.is_some()
}

/// In the folder that systemd has made for the unit (`RuntimeDirectory=`), whose user may not be root.
fn default_socket(master: u32) -> Result<PathBuf> {
    if let Some(directory) = std::env::var_os("RUNTIME_DIRECTORY") {
        return Ok(Path::new(&directory).join(format!("master{master}.sock")));
    }
    let is_root = rustix::process::geteuid().is_root();
    let path = default_paths(master).into_iter().nth(usize::from(!is_root));
    path.ok_or_else(|| Failure::Usage("XDG_RUNTIME_DIR is not set; set --socket".to_owned()))
}

/// Serves a bus without a cycle. A simulation needs a thread that lets its time pass.
fn idle(backend: &Backend, interrupt: &Interrupt, notifier: &Notifier) -> Result {
    let runner = backend.simulation.as_ref().map(ecan_sim::Simulation::keep_running);
    let _runner = runner.transpose().map_err(|error| Failure::Host(error.to_string()))?;
    notifier.send(Event::Idle);
    while !interrupt.is_set() {
        notifier.cycle();
        sleep(POLL);
    }
    Ok(())
}
