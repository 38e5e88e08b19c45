//! `ecan diag`: what is wrong with a gateway, why, and what to do (manual 16).

mod bundle;
mod clear;
mod read;
mod report;
mod text;

use std::path::{Path, PathBuf};

use clap::Args;

use crate::bus::Bus;
use crate::failure::Failure;
use crate::global::GlobalOptions;
use crate::output::Output;
use crate::slave_choice::AllArgument;

use bundle::Bundle;
use report::Report;

/// How to look.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  ecan diag
  ecan diag --brief --slave 1
  ecan diag --brief --all            one report after the other, of every gateway
  ecan diag --record bundle.json     everything in one file, to send to the support
  ecan diag --from bundle.json       explain such a file; touches no bus
  ecan diag --clear                  clear counters and flags after they were read

Exit status 1 when there is a finding. A gateway that waits in PREOP for its master is well.")]
pub struct DiagArguments {
    /// Write everything that was read, versions and the state of the host to a file
    #[arg(long, value_name = "FILE", conflicts_with = "all")]
    record: Option<PathBuf>,
    /// Explain a file that --record wrote
    #[arg(long, value_name = "FILE", conflicts_with_all = ["record", "clear", "all"])]
    from: Option<PathBuf>,
    /// Clear PDO errors (0x8010/0x8011:08), cycle statistics (0x9011:14) and diagnostic flags
    /// (0xB000:04 bit 5) after reading
    #[arg(long)]
    clear: bool,
    #[command(flatten)]
    all: AllArgument,
    /// Print the findings only
    #[arg(long)]
    brief: bool,
    /// IgH's command line tool, which reads the AL status code; otherwise ethercat on the PATH or where
    /// IgH installs it
    #[arg(long, value_name = "PROGRAM")]
    ethercat: Option<PathBuf>,
}

pub fn run(
    arguments: &DiagArguments,
    global: &GlobalOptions,
    output: &Output,
) -> Result<(), Failure> {
    if let Some(path) = &arguments.from {
        global.without_slave("--from explains a file, which is of one gateway")?;
        return explain(&[Bundle::load(path)?], arguments, output);
    }
    let bus = Bus::open(global, output)?;
    let slaves = read::slaves(&bus, arguments.all.all)?;
    let look = |slave: &usize| read::bundle(&bus, *slave, arguments, global, output);
    let bundles = slaves.iter().map(look).collect::<Result<Vec<_>, _>>()?;
    // What was read is told whatever becomes of the rest; and what was not recorded is not cleared.
    let explained = explain(&bundles, arguments, output);
    if let (Some(path), [bundle]) = (&arguments.record, &bundles[..]) {
        bundle.save(path)?;
        output.note(format_args!("recorded in {}", path.display()));
    }
    if arguments.clear {
        clear_all(&bus, &slaves, arguments.all.all, output)?;
    }
    explained
}

/// Clears every one that lets itself be cleared; tells of the first that does not.
fn clear_all(
    bus: &Bus,
    slaves: &[usize],
    names_slave: bool,
    output: &Output,
) -> Result<(), Failure> {
    let mut failed = None;
    for slave in slaves {
        let place = if names_slave { format!("slave {slave}: ") } else { String::new() };
        match clear::clear(bus, *slave) {
            Ok(()) => output.note(format_args!("{place}counters and flags are cleared")),
            Err(failure) => failed = failed.or(Some(failure)),
        }
    }
    failed.map_or(Ok(()), Err)
}

/// Prints what was read; [`Failure::Amiss`] where there is a finding.
fn explain(bundles: &[Bundle], arguments: &DiagArguments, output: &Output) -> Result<(), Failure> {
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
        false => Err(Failure::Amiss),
    }
}

fn file_failure(what: &'static str, path: &Path, reason: impl ToString) -> Failure {
    Failure::File { what, path: path.to_owned(), reason: reason.to_string() }
}
