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

use bundle::Bundle;
use report::Report;

/// How to look.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  ecan diag
  ecan diag --brief --slave 1
  ecan diag --record bundle.json     everything in one file, to send to the support
  ecan diag --from bundle.json       explain such a file; touches no bus
  ecan diag --clear                  clear counters and flags after they were read

Exit status 1 when there is a finding. A gateway that waits in PREOP for its master is well.")]
pub struct DiagArguments {
    /// Write everything that was read, versions and the state of the host to a file
    #[arg(long, value_name = "FILE")]
    record: Option<PathBuf>,
    /// Explain a file that --record wrote
    #[arg(long, value_name = "FILE", conflicts_with_all = ["record", "clear", "slave"])]
    from: Option<PathBuf>,
    /// Clear PDO errors (0x8010/0x8011:08), cycle statistics (0x9011:14) and diagnostic flags
    /// (0xB000:04 bit 5) after reading
    #[arg(long)]
    clear: bool,
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
        let bundle = Bundle::load(path)?;
        return explain(&bundle, arguments.brief, output);
    }
    let bus = Bus::open(global, output)?;
    let slave = read::slave(&bus)?;
    let bundle = read::bundle(&bus, slave, arguments, global, output)?;
    // What was read is told whatever becomes of the rest; and what was not recorded is not cleared.
    let explained = explain(&bundle, arguments.brief, output);
    if let Some(path) = &arguments.record {
        bundle.save(path)?;
        output.note(format_args!("recorded in {}", path.display()));
    }
    if arguments.clear {
        clear::clear(&bus, slave)?;
        output.note("counters and flags are cleared");
    }
    explained
}

/// Prints what was read; [`Failure::Amiss`] where there is a finding.
fn explain(bundle: &Bundle, is_brief: bool, output: &Output) -> Result<(), Failure> {
    let report = Report::new(bundle);
    output.data(&report, |out| text::print(&report, is_brief, output, out))?;
    if report.findings.is_empty() { Ok(()) } else { Err(Failure::Amiss) }
}

fn file_failure(what: &'static str, path: &Path, reason: impl ToString) -> Failure {
    Failure::File { what, path: path.to_owned(), reason: reason.to_string() }
}
