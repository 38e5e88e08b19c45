//! `ecan diag`: problems of a gateway, with causes and remedies (manual 16).

mod report;

use std::path::PathBuf;

use clap::Args;
use ecan_host::{Maintenance, MaintenanceError};
use ecan_protocol::device::MaintenanceCommand;
use ecan_protocol::text::Printable;
use ecan_tool_support::diagnosis::Depth;
use report::DiagnosisReport;

use crate::commands::bundle::{
    Bundle, Evidence, Gateway, RecordArguments, connection, read_gateway, selected_slaves,
};
use crate::commands::doctor::{Check, Root, host_checks};
use crate::context::{Bus, Context, Failure, Output, Result, note};
use crate::frames::ServiceEvents;
use crate::output::Progress;
use crate::slave_choice::AllArgument;

#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  ecan diag
  ecan diag --brief --slave 1
  ecan diag --brief --all            one report per gateway
  ecan diag --record bundle.json     write a bundle for support
  ecan diag --from bundle.json       explain a bundle, offline
  ecan diag --clear                  clear counters and flags after reading

Exit status 1 if there is a finding. A gateway in PREOP without application is not a finding.")]
pub struct DiagArguments {
    #[command(flatten)]
    record: RecordArguments,
    /// Explain a file written by --record, offline
    #[arg(long, value_name = "FILE", conflicts_with_all = ["record", "clear", "all"])]
    from: Option<PathBuf>,
    /// Clear PDO errors, cycle statistics and diagnostic flags after reading
    #[arg(long)]
    clear: bool,
    #[command(flatten)]
    all: AllArgument,
    /// Print the findings only
    #[arg(long)]
    brief: bool,
    /// Path of IgH's tool ethercat, which reads the AL status [default: PATH, IgH's paths]
    #[arg(long, value_name = "PROGRAM")]
    ethercat: Option<PathBuf>,
}

pub fn run(arguments: &DiagArguments, context: &Context) -> Result {
    if let Some(path) = &arguments.from {
        context.global.without_slave("--from explains the gateways of a file")?;
        let bundle = Bundle::load(path)?;
        if let Some(failure) = &bundle.failure {
            note(format_args!("the bundle was written after a failure: {}", Printable(failure)));
        }
        let events = bundle.service_events();
        return explain(&bundle.gateways, events.as_ref(), arguments, &context.output);
    }
    let mut reading = Reading::default();
    let read = reading.read(arguments, context);
    let Reading { bus, slaves, gateways } = reading;
    let events = connection(bus.as_ref(), context).as_ref().and_then(ServiceEvents::read);
    // Print the report even if the rest fails; clear only after recording.
    let explained = match gateways.is_empty() && context.global.json {
        true => Ok(()),
        false => explain(&gateways, events.as_ref(), arguments, &context.output),
    };
    let is_read = read.is_ok();
    let result = read.and(explained);
    let is_requested = arguments.record.is_requested();
    let checks = if is_requested { default_host_checks(context) } else { Vec::new() };
    let evidence = Evidence { bus: bus.as_ref(), checks: &checks, gateways, failure: None };
    let result = arguments.record.save(evidence, result, context);
    let is_kept = !is_requested || matches!(result, Ok(()) | Err(Failure::Recorded { .. }));
    if let Some(bus) = bus.filter(|_| arguments.clear && is_read && is_kept) {
        clear_all(&bus, &slaves)?;
    }
    result
}

/// What a command has read before it failed.
#[derive(Default)]
struct Reading {
    bus: Option<Bus>,
    slaves: Vec<usize>,
    gateways: Vec<Gateway>,
}

impl Reading {
    fn read(&mut self, arguments: &DiagArguments, context: &Context) -> Result {
        let bus = self.bus.insert(context.bus()?);
        let is_recorded = arguments.record.is_requested();
        let all = arguments.all.all || is_recorded && !bus.is_chosen();
        self.slaves = selected_slaves(bus, all)?;
        let progress = Progress::show("reading the gateways");
        let depth = if is_recorded { Depth::Everything } else { Depth::Findings };
        let ethercat = arguments.ethercat.as_deref();
        let read = |bus: &Bus, slave| read_gateway(bus, slave, depth, ethercat);
        let results = bus.in_parallel(&self.slaves, read);
        drop(progress);
        let mut failed = None;
        for result in results {
            match result {
                Ok(gateway) => self.gateways.push(gateway),
                Err(failure) => failed = failed.or(Some(failure)),
            }
        }
        failed.map_or(Ok(()), Err)
    }
}

/// The bundle of one gateway, as `--record` writes it, with what could be read.
pub fn gather(
    bus: &Bus,
    slave: usize,
    failure: Option<String>,
    context: &Context,
) -> impl serde::Serialize + use<> {
    let read = read_gateway(bus, slave, Depth::Everything, None);
    let failure = failure.or(read.as_ref().err().map(ToString::to_string));
    let checks = &default_host_checks(context);
    let gateways = read.into_iter().collect();
    Bundle::gather(Evidence { bus: Some(bus), checks, gateways, failure }, None, context)
}

fn default_host_checks(context: &Context) -> Vec<Check> {
    host_checks(&Root::default(), context.global.master())
}

/// Clears every gateway; returns the first error.
fn clear_all(bus: &Bus, slaves: &[usize]) -> Result {
    let names_slave = slaves.len() > 1;
    let mut failed = None;
    for slave in slaves {
        let prefix = if names_slave { format!("slave {slave}: ") } else { String::new() };
        match clear(bus, *slave) {
            Ok(()) => note(format_args!("{prefix}counters and flags cleared")),
            Err(failure) => failed = failed.or(Some(failure)),
        }
    }
    failed.map_or(Ok(()), Err)
}

/// Prints a report of each gateway, and the events of the service.
fn explain(
    gateways: &[Gateway],
    events: Option<&ServiceEvents>,
    arguments: &DiagArguments,
    output: &Output,
) -> Result {
    let report =
        |gateway| DiagnosisReport { service_events: events, ..DiagnosisReport::new(gateway) };
    let reports: Vec<_> = gateways.iter().map(report).collect();
    output.one_or_list(arguments.all.all || reports.len() > 1, &reports, |out| {
        for (number, report) in reports.iter().enumerate() {
            if number != 0 {
                writeln!(out)?;
            }
            report::print(report, arguments.brief, output, out)?;
        }
        events.iter().filter(|_| !arguments.brief).try_for_each(|events| events.print(out))
    })?;
    match reports.iter().all(|report| report.findings.is_empty()) {
        true => Ok(()),
        false => Err(Failure::ProblemsFound),
    }
}

/// Clears the PDO errors of both directions, the cycle statistics, the runtime diagnostics and
/// flags.
fn clear(bus: &Bus, slave: usize) -> Result {
    for profile in [0x8010, 0x8011] {
        bus.write(slave, profile, 8, 0b10)?;
    }
    bus.write(slave, 0x9011, 14, 1)?;
    let maintenance = Maintenance::new(bus.diagnostics(), slave);
    let cleared = maintenance.command(MaintenanceCommand::ClearDiagnostics, bus.clock());
    cleared.map_err(|error| match error {
        MaintenanceError::Device(error) => Failure::Device(error),
        other => Failure::Rejected(format!("diagnostics not cleared: {other}")),
    })
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use ecan_host::AdapterConfig;
    use ecan_mcan_port::{ChannelConfig, GatewayConfig, Port, PortConfig};
    use ecan_sim::{ClockKind, SimOptions};

    use super::*;

    #[test]
    fn counters_of_an_operation_are_cleared() {
        let options = SimOptions { clock: Some(ClockKind::Stepped), ..SimOptions::default() };
        let backend = ecan_sim::open_scenario(ecan_sim::echo(1), &options).unwrap();
        let simulation = backend.simulation.clone().unwrap();
        let gateway = GatewayConfig::on_channel(0, ChannelConfig::classic(500_000));
        let adapter = AdapterConfig::new(1).with_cycle(Duration::from_millis(1));
        let mut port =
            Port::open(&backend.ecrt, (adapter, PortConfig::uniform(1, gateway))).unwrap();
        port.wait_ready().unwrap();
        simulation.pass_ns(300_000);
        let damage = |gateway: &mut ecan_sim::Gateway, now| gateway.write_outputs(now, &[0; 384]);
        let is_taken = simulation.with_world(|world| world.with_gateway(0, damage));
        assert_eq!(is_taken, Some(true));
        simulation.pass_ns(300_000);
        drop(port);
        simulation.pass_ns(2_000_000_000);

        let bus = Bus::over(&backend.ecrt);
        let counts = || {
            [(0x8011, 14), (0x8011, 15), (0x9011, 1)]
                .map(|(index, subindex)| bus.read(0, index, subindex).unwrap())
        };
        let before = counts();
        assert_eq!(before[..2], [14, 1], "an all-zero image has a bad header");
        assert!(before[2] > 0);
        clear(&bus, 0).unwrap();
        assert_eq!(counts(), [0, 0, 0]);
    }
}
