//! `ecan diag`: problems of a gateway, with causes and remedies (manual 16).

mod bundle;
mod clear;
mod read;
mod report;
mod text;

use std::path::PathBuf;

use clap::Args;
use ecan_protocol::text::Printable;

use crate::context::{Bus, Context, Failure, Output, Result, note};
use crate::progress::Progress;
use crate::slave_choice::AllArgument;

use bundle::Bundle;
use report::Report;

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
    /// Write a support bundle: values, versions and the state of the host
    #[arg(long, value_name = "FILE", conflicts_with = "all")]
    record: Option<PathBuf>,
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
        context.global.without_slave("--from explains the gateway of a file")?;
        return explain(&[Bundle::load(path)?], arguments, &context.output);
    }
    let bus = context.bus()?;
    let slaves = read::slaves(&bus, arguments.all.all)?;
    let progress = Progress::show("reading the gateways");
    let bundles =
        bus.in_parallel(&slaves, |bus, slave| read::bundle(bus, slave, arguments, context));
    drop(progress);
    let bundles = bundles.into_iter().collect::<Result<Vec<_>, _>>()?;
    // Print the report even if the rest fails; clear only after recording.
    let explained = explain(&bundles, arguments, &context.output);
    if let (Some(path), [bundle]) = (&arguments.record, &bundles[..]) {
        bundle.save(path)?;
        note(format_args!("written to {}", Printable(path.display())));
    }
    if arguments.clear {
        clear_all(&bus, &slaves, arguments.all.all)?;
    }
    explained
}

/// Writes a bundle, as `--record` does.
pub fn record(bus: &Bus, slave: usize, path: &std::path::Path, context: &Context) -> Result {
    let arguments = DiagArguments {
        record: Some(path.to_owned()),
        from: None,
        clear: false,
        all: AllArgument { all: false },
        brief: false,
        ethercat: None,
    };
    read::bundle(bus, slave, &arguments, context)?.save(path)
}

/// Clears every gateway; returns the first error.
fn clear_all(bus: &Bus, slaves: &[usize], names_slave: bool) -> Result {
    let mut failed = None;
    for slave in slaves {
        let prefix = if names_slave { format!("slave {slave}: ") } else { String::new() };
        match clear::clear(bus, *slave) {
            Ok(()) => note(format_args!("{prefix}counters and flags cleared")),
            Err(failure) => failed = failed.or(Some(failure)),
        }
    }
    failed.map_or(Ok(()), Err)
}

fn explain(bundles: &[Bundle], arguments: &DiagArguments, output: &Output) -> Result {
    let reports: Vec<_> = bundles.iter().map(Report::new).collect();
    output.one_or_list(arguments.all.all, &reports, |out| {
        for (number, report) in reports.iter().enumerate() {
            if number != 0 {
                writeln!(out)?;
            }
            text::print(report, arguments.brief, output, out)?;
        }
        Ok(())
    })?;
    match reports.iter().all(|report| report.findings.is_empty()) {
        true => Ok(()),
        false => Err(Failure::ProblemsFound),
    }
}
