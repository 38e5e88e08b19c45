//! `ecan doctor`: problems of the host and their remedies.
//!
//! Each check of files is a function that reads below a root directory.

mod check;
mod gateways;
mod host;

use std::io::Write;
use std::path::{Path, PathBuf};

use check::Verdict;
pub use check::{Check, Root};
use clap::Args;
use ecan_host::Diagnostics;
use ecan_sim::Backend;

use crate::commands::bundle::{Evidence, RecordArguments};
use crate::context::{Context, Failure, Output, Result, Tone};
use crate::ethercat_tool::EthercatTool;
use crate::output;

#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  ecan doctor
  ecan doctor --root /mnt/image      check the files of another system
  ecan doctor --record bundle.json   write a bundle for support: host, master, service

Exit status 1 if problems are found.")]
pub struct DoctorArguments {
    /// Check the files below this directory, without library and bus
    #[arg(long, value_name = "DIRECTORY", conflicts_with = "record")]
    root: Option<PathBuf>,
    /// Path of ethtool for the interrupt coalescing [default: found, not with --root]
    #[arg(long, value_name = "PROGRAM")]
    ethtool: Option<PathBuf>,
    /// Path of IgH's tool ethercat, which reads the SII [default: PATH, IgH's paths]
    #[arg(long, value_name = "PROGRAM")]
    ethercat: Option<PathBuf>,
    #[command(flatten)]
    record: RecordArguments,
}

pub fn run(arguments: &DoctorArguments, context: &Context) -> Result {
    context.global.without_slave("doctor checks the host; use `ecan diag` for a gateway")?;
    context.global.without_service("doctor checks this host")?;
    let root = match &arguments.root {
        Some(path) if !path.is_dir() => {
            return Err(Failure::file("read", path, "not a directory"));
        }
        Some(path) => Root::at(path.clone()),
        None => Root::default(),
    };
    let root = root.with_ethtool(arguments.ethtool.clone());
    let of_files = || host_checks(&root, context.global.master());
    let (checks, result) = match &arguments.root {
        Some(_) => (of_files(), Ok(())),
        None => match all_checks(&root, arguments.ethercat.as_deref(), context) {
            Ok(checks) => (checks, Ok(())),
            Err(failure) => (of_files(), Err(failure)),
        },
    };
    let result = result.and_then(|()| {
        context.output.data(&checks, |out| print(&checks, &context.output, out))?;
        let has_problem = checks.iter().any(Check::has_problem);
        if has_problem { Err(Failure::ProblemsFound) } else { Ok(()) }
    });
    if !arguments.record.is_requested() {
        return result;
    }
    let (bus, failure) = match context.bus() {
        Ok(bus) => (Some(bus), None),
        Err(failure) => (None, Some(failure.to_string())),
    };
    let evidence = Evidence { bus: bus.as_ref(), checks: &checks, gateways: Vec::new(), failure };
    arguments.record.save(evidence, result, context)
}

/// Checks of files.
pub fn host_checks(root: &Root, master: u32) -> Vec<Check> {
    [master_checks(root, master), real_time_checks(root)].concat()
}

type MasterCheck = fn(&Root, u32) -> Check;

const MASTER_CHECKS: [(&str, MasterCheck); 5] = [
    ("kernel module", |root, _| gateways::kernel_module(root)),
    ("network driver", |root, _| gateways::network_driver(root)),
    ("device node", gateways::device_node),
    ("interface", host::link),
    ("coalescing", host::coalescing),
];

type HostCheck = fn(&Root) -> Check;

const REAL_TIME_CHECKS: [(&str, HostCheck); 7] = [
    ("real-time kernel", host::kernel),
    ("real-time priority", host::priority_limit),
    ("locked memory", host::memory_limit),
    ("isolated CPUs", host::isolated_cpus),
    ("clock source", host::clock_source),
    ("power governor", host::power_governor),
    ("sleep states", host::sleep_states),
];

fn master_checks(root: &Root, master: u32) -> Vec<Check> {
    MASTER_CHECKS.map(|(name, check)| check(root, master).named(name)).to_vec()
}

fn real_time_checks(root: &Root) -> Vec<Check> {
    REAL_TIME_CHECKS.map(|(name, check)| check(root).named(name)).to_vec()
}

/// Checks of files, library and bus.
fn all_checks(root: &Root, tool: Option<&Path>, context: &Context) -> Result<Vec<Check>> {
    let library = gateways::load(context)?;
    let mut checks = vec![gateways::check(&library).named("library")];
    let master = context.global.master();
    let bus = library.as_ref().ok().map(|library| Diagnostics::of_bus(&library.ecrt, master));
    match &library {
        Ok(backend) if backend.simulation.is_some() => {
            let skipped = Check::skipped("not needed with a simulated master");
            checks.extend(MASTER_CHECKS.map(|(name, _)| skipped.clone().named(name)));
        }
        Ok(Backend { ecrt, .. }) => {
            let running = EthercatTool::find(tool, master);
            let running = running.and_then(|tool| tool.main_device()).ok();
            let root = &root.clone().with_main_device(running);
            let failure = bus.as_ref().and_then(|bus| bus.as_ref().err());
            checks.push(gateways::same_version(root, ecrt.version(), failure).named("versions"));
            checks.extend(master_checks(root, master));
        }
        Err(_) => checks.extend(master_checks(root, master)),
    }
    checks.extend(real_time_checks(root));
    let simulation = library.ok().and_then(|library| library.simulation);
    checks.extend(gateways::checks(bus, simulation.as_ref(), tool, master));
    Ok(checks)
}

fn print(checks: &[Check], output: &Output, out: &mut dyn Write) -> std::io::Result<()> {
    output::print(out, checks, |check| {
        let word = format!("{:7}", check.verdict.word());
        let word = output.toned(tone(check.verdict), word);
        [word, check.name.to_owned(), check.found.clone()]
    })?;
    for check in checks.iter().filter(|check| check.has_problem()) {
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
