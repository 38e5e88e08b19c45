//! `ecan zenoh`: publishes a service to other hosts.

use std::cell::Cell;
use std::path::PathBuf;
use std::sync::Arc;
use std::thread::sleep;
use std::time::Duration;

use clap::Args;
use ecan_service::client::Access;
use ecan_service::server::{MetricsAddress, MetricsConfig, MetricsServer, ServiceError};
use ecan_service_zenoh::{
    Keys, Publication, PublicationConfig, PublicationError, TransmitLimits, TransmitRule,
};
use ecan_tool_support::command_line::interrupt::Interrupt;
use ecan_tool_support::command_line::options::milliseconds;

use crate::context;
use crate::context::{Context, Failure, Result, note};
use crate::service_access::{ServiceAddress, host_name};

pub const EXAMPLES: &str = "\
Examples:
  ecan --via zenoh:ecan/cell7/master0 dump     the frames of another host; ZENOH_CONFIG names a configuration
  ecan zenoh zenoh.json5                       other hosts read the service of master 0
  ecan zenoh zenoh.json5 --control             they also send frames and write objects
  ecan zenoh zenoh.json5 --control --transmit 0.1:100-1FF
                                               they send these CAN IDs on channel 1 only
  ecan --via /run/cell.sock zenoh zenoh.json5  the service of an application

Keys and payloads: docs/SERVICE.md. Encryption and access control: in the configuration of Zenoh,
examples/zenoh has one for router, publisher, viewer and operator.";

/// Pause before another attempt to reach a service that ended.
const PAUSE: Duration = Duration::from_secs(1);
/// Interval of looking for signals in a pause.
const POLL: Duration = Duration::from_millis(50);

#[derive(Debug, Args)]
pub struct ZenohArguments {
    /// Configuration of Zenoh (JSON5); it listens and uses multicast only if configured
    #[arg(value_name = "FILE")]
    file: PathBuf,
    /// Permit remote clients to send frames and to change something
    #[arg(long)]
    control: bool,
    /// Limit remote frames to GATEWAY.CHANNEL[:ID[-ID]]; may be repeated
    #[arg(long, value_name = "RULE", requires = "control")]
    transmit: Vec<TransmitRule>,
    /// Prefix of the keys [default: ecan/<HOST>/master<N>]
    #[arg(long, value_name = "KEY", value_parser = Keys::new)]
    prefix: Option<Keys>,
    /// Interval of the states, 10ms to 60s
    #[arg(long, value_name = "TIME", default_value = "1s", value_parser = milliseconds::<u32>(10..=60_000))]
    interval: u32,
    /// Time that a frame waits for further ones, 0 to 1s; 0 has the shortest round trip
    #[arg(long, value_name = "TIME", default_value = "5ms", value_parser = milliseconds::<u32>(0..=1000))]
    gather: u32,
    /// Serve metrics for Prometheus at this address: 127.0.0.1:PORT or unix:PATH
    #[arg(long, value_name = "ADDRESS")]
    metrics: Option<MetricsAddress>,
    /// Permit an address of --metrics that other hosts reach
    #[arg(long, requires = "metrics")]
    metrics_remote: bool,
}

impl ZenohArguments {
    fn serve_metrics(
        &self,
        address: &MetricsAddress,
        publication: &Arc<Publication>,
    ) -> Result<MetricsServer> {
        let allows_remote = self.metrics_remote;
        let config = MetricsConfig { allows_remote, ..MetricsConfig::new(address.clone()) };
        let publication = publication.clone();
        let server =
            MetricsServer::start(&config, (0o660, None), move || Ok(publication.metrics()));
        let server = server.map_err(|error| match error {
            ServiceError::RemoteMetrics(_) => Failure::Usage(error.to_string()),
            error => Failure::Host(error.to_string()),
        })?;
        note(format_args!("metrics at {}", server.address()));
        Ok(server)
    }
}

pub fn run(arguments: &ZenohArguments, context: &Context) -> Result {
    context.global.without_slave("it publishes the whole service")?;
    let interrupt = Interrupt::install()?;
    let connection =
        context::connect(context.global, context.global.master())?.ok_or_else(|| {
            Failure::Master("no service to publish; start ecan serve, or set --via".to_owned())
        })?;
    let ServiceAddress::Socket(path) = connection.address().clone() else {
        let message =
            "a service of another host is published there; set --via to a socket".to_owned();
        return Err(Failure::Usage(message));
    };
    let hello = connection.hello().clone();
    drop(connection);
    if arguments.control && hello.access != Access::Control {
        let reason = hello.access_reason.unwrap_or_default();
        note(format_args!("warning: --control has no effect: {reason}"));
    }
    let keys = arguments.prefix.clone();
    let keys = keys.unwrap_or_else(|| Keys::of_host(host_name().trim(), hello.master));
    let prefix = keys.prefix().to_owned();
    let config = PublicationConfig {
        keys,
        has_control: arguments.control,
        limits: TransmitLimits { rules: arguments.transmit.clone() },
        interval: Duration::from_millis(arguments.interval.into()),
        gather: Duration::from_millis(arguments.gather.into()),
    };
    let publication = Arc::new(Publication::open(&arguments.file, config).map_err(failure)?);
    let _metrics =
        arguments.metrics.as_ref().map(|address| arguments.serve_metrics(address, &publication));
    let _metrics = _metrics.transpose()?;
    let access = if arguments.control { "control" } else { "read-only" };
    note(format_args!("publishing {prefix}/** through Zenoh, remote clients: {access}"));
    if let Some(reason) = publication.open_control() {
        note(format_args!(
            "warning: control is open in {}: {reason}; every program that reaches this session can \
             send frames and write objects; see docs/SERVICE.md, \"Security\"",
            arguments.file.display()
        ));
    }
    let is_lost = Cell::new(false);
    let report = |event| {
        if is_lost.replace(false) {
            note("service found again");
        }
        note(event);
    };
    while !interrupt.is_set() {
        match publication.run(&path, &|| interrupt.is_set(), &report) {
            Ok(()) => {}
            Err(PublicationError::Service(error)) => {
                if !is_lost.replace(true) {
                    note(format_args!("service lost: {error}; waiting for it"));
                }
                pause(&interrupt);
            }
            Err(error) => return Err(failure(error)),
        }
    }
    Ok(())
}

fn failure(error: PublicationError) -> Failure {
    match error {
        PublicationError::Service(error) => Failure::master(error),
        error => Failure::Publication(error.to_string()),
    }
}

fn pause(interrupt: &Interrupt) {
    let mut left = PAUSE;
    while !left.is_zero() && !interrupt.is_set() {
        sleep(POLL);
        left = left.saturating_sub(POLL);
    }
}
