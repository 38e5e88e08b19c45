//! `ecan doctor`: what is wrong with the host and its set-up, and the remedy.
//!
//! What the host shows in files is looked at below a root directory, each by a function of its own.

mod check;
mod gateways;
mod interface;
mod library;
mod master;
mod real_time;
mod root;
mod sii;

use std::io::Write;
use std::path::{Path, PathBuf};

use clap::Args;

use crate::failure::Failure;
use crate::global::GlobalOptions;
use crate::output::{Output, Tone};
use crate::table;

pub use check::Check;
use check::Verdict;
pub use root::Root;

/// How to look at the host.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  ecan doctor
  ecan doctor --root /mnt/image      look at another system's files

Exit status 1 when something is amiss.")]
pub struct DoctorArguments {
    /// Look at the host's files below this directory; leaves out library and bus
    #[arg(long, value_name = "DIRECTORY")]
    root: Option<PathBuf>,
    /// The ethtool to ask for the interrupt coalescing; found by itself, but not with --root
    #[arg(long, value_name = "PROGRAM")]
    ethtool: Option<PathBuf>,
    /// IgH's command line tool, which reads the SII; otherwise ethercat on the PATH or where IgH
    /// installs it
    #[arg(long, value_name = "PROGRAM")]
    ethercat: Option<PathBuf>,
}

pub fn run(
    arguments: &DoctorArguments,
    global: &GlobalOptions,
    output: &Output,
) -> Result<(), Failure> {
    global.without_slave("it looks at the host; one gateway is looked at by `ecan diag`")?;
    let checks = match &arguments.root {
        Some(path) if !path.is_dir() => {
            let (path, reason) = (path.clone(), "it is no directory".to_owned());
            return Err(Failure::File { what: "look at", path, reason });
        }
        Some(path) => {
            let root = Root::at(path.clone()).with_ethtool(arguments.ethtool.clone());
            host_checks(&root, global.master())
        }
        None => {
            let root = Root::default().with_ethtool(arguments.ethtool.clone());
            all_checks(&root, arguments.ethercat.as_deref(), global, output)?
        }
    };
    output.data(&checks, |out| print(&checks, output, out))?;
    let is_amiss = checks.iter().any(Check::is_amiss);
    if is_amiss { Err(Failure::Amiss) } else { Ok(()) }
}

/// The checks that look at files.
pub fn host_checks(root: &Root, master: u32) -> Vec<Check> {
    [master_checks(root, master), real_time_checks(root)].concat()
}

fn master_checks(root: &Root, master: u32) -> Vec<Check> {
    vec![
        master::kernel_module(root),
        master::network_driver(root),
        master::device_node(root, master),
        interface::link(root, master),
        interface::coalescing(root, master),
    ]
}

fn real_time_checks(root: &Root) -> Vec<Check> {
    vec![
        real_time::kernel(root),
        real_time::priority_limit(root),
        real_time::memory_limit(root),
        real_time::isolated_cpus(root),
        real_time::clock_source(root),
        real_time::power_governor(root),
        real_time::sleep_states(root),
    ]
}

/// Library and bus besides.
fn all_checks(
    root: &Root,
    tool: Option<&Path>,
    global: &GlobalOptions,
    output: &Output,
) -> Result<Vec<Check>, Failure> {
    let library = library::load(global, output)?;
    let mut checks = vec![library::check(&library)];
    match &library {
        Ok(ecrt) if ecrt.is_simulated() => {
            let names =
                ["kernel module", "network driver", "device node", "interface", "coalescing"];
            let skipped = |name| Check::skipped(name, "not needed: the master is simulated");
            checks.extend(names.map(skipped));
        }
        Ok(ecrt) => {
            checks.push(library::same_version(root, ecrt.version()));
            checks.extend(master_checks(root, global.master()));
        }
        Err(_) => checks.extend(master_checks(root, global.master())),
    }
    checks.extend(real_time_checks(root));
    checks.extend(gateways::checks(library.ok(), tool, global));
    Ok(checks)
}

fn print(checks: &[Check], output: &Output, out: &mut dyn Write) -> std::io::Result<()> {
    let rows: Vec<_> = checks
        .iter()
        .map(|check| {
            let word = format!("{:7}", check.verdict.word());
            let word = output.toned(tone(check.verdict), word);
            [word, check.name.to_owned(), check.found.clone()]
        })
        .collect();
    table::print(out, &rows)?;
    for check in checks.iter().filter(|check| check.is_amiss()) {
        let name = output.toned(tone(check.verdict), check.name);
        writeln!(out, "\n{name}: {}\n  remedy: {}", check.found, check.remedy)?;
    }
    Ok(())
}

fn tone(verdict: Verdict) -> Tone {
    match verdict {
        Verdict::Good => Tone::Good,
        Verdict::Warning => Tone::Warning,
        Verdict::Bad => Tone::Bad,
        Verdict::Skipped => Tone::Faint,
    }
}
