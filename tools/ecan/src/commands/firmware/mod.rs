//! `ecan firmware`: shows and updates the firmware (manual 15.3.1).

mod access;
mod package;
mod update;
#[cfg(test)]
mod update_tests;

use std::io::Write;
use std::path::PathBuf;
use std::time::Duration;

use access::{ByTool, Gateways, Running, Selection, Simulated};
use clap::{Args, Subcommand};
use ecan_sim::{ClockKind, EcrtSetting};
use ecan_tool_support::command_line::interrupt::Interrupt;
use ecan_tool_support::command_line::options::seconds;
use package::FirmwareFile;
use serde::Serialize;
use update::{GatewayUpdate, Outcome, Update};

use crate::context::{Bus, Context, Failure, Output, Result, Tone, note};
use crate::ethercat_tool::SlaveEntry;
use crate::output::confirm;
use crate::{context, output};

/// Show or update the firmware over FoE (manual 15.3.1)
///
/// Uses IgH's command line tool ethercat, because its library has no FoE functions. With --ecrt
/// sim, the gateways are simulated in this process.
#[derive(Debug, Args)]
pub struct FirmwareArguments {
    #[command(subcommand)]
    action: Action,
    /// Path of IgH's tool ethercat [default: PATH, IgH's paths]
    #[arg(long, global = true, value_name = "PATH")]
    ethercat: Option<PathBuf>,
    /// Process all gateways of the bus in turn
    #[arg(long, global = true)]
    all: bool,
}

#[derive(Debug, Subcommand)]
enum Action {
    /// Show the running firmware (0x100A, 0xF000:05 and :06)
    Version,
    /// Write a firmware package, wait for the restart and read the version back
    #[command(after_help = "\
Examples:
  sudo ecan firmware update /tmp/ecan_lite_v140494.bin
  sudo ecan firmware update new.bin --all --yes --expect-version 14.4.94
  ecan --ecrt sim firmware update new.bin --yes     (new.bin from `ecan-sim firmware`)

With --all, the command stops at a gateway that does not respond after the restart, or that runs
another version than the expected one; the remaining gateways are not changed.

Ctrl-C stops the command after the current gateway.

An update succeeds if the version changed, or if the expected version runs after a restart. Exit
status 1: wrong version, gateway not identified, or interrupted; 5: gateway rejected the file or does
not respond after the restart.

The ethercat tool is killed after 10 minutes (transfer) or 5 seconds (other commands).")]
    Update(UpdateArguments),
}

#[derive(Debug, Args)]
struct UpdateArguments {
    /// Firmware package, ecan_lite_v*.bin
    file: PathBuf,
    /// Do not ask for confirmation
    #[arg(long)]
    yes: bool,
    /// Expected version after the update, as in 0x100A or MAJOR.MINOR.BUILD
    #[arg(long, value_name = "VERSION")]
    expect_version: Option<String>,
    /// Time limit for the restart of a gateway
    #[arg(long, value_name = "TIME", default_value = "60s", value_parser = seconds::<u32>(0..=100_000))]
    timeout: u32,
}

/// Output of `version` for a gateway.
#[derive(Debug, Serialize)]
struct Version {
    position: usize,
    state: String,
    #[serde(flatten)]
    running: Option<Running>,
    /// Reason for a missing version.
    error: Option<String>,
}

/// Output of `update` for a gateway.
#[derive(Debug, Serialize)]
struct UpdateReport<'a> {
    #[serde(flatten)]
    report: &'a GatewayUpdate,
    is_good: bool,
    text: String,
}

pub fn run(arguments: &FirmwareArguments, context: &Context) -> Result {
    if let Some(connection) = context::connect(context.global, context.global.master())? {
        return Err(Failure::Master(format!(
            "a service does not transfer firmware (FoE), and {} holds the master; end that program, or \
             use --via direct if the gateway may restart in parallel with it; `ecan info` shows the version",
            connection.program()
        )));
    }
    match &arguments.action {
        Action::Version => {
            let (gateways, _) = open(arguments, context)?;
            let chosen = access::chosen(&*gateways, context.global.slave, arguments.all)?;
            version(&*gateways, chosen, &context.output)
        }
        Action::Update(options) => {
            // Check the file first: this needs no bus.
            let file = FirmwareFile::read(&options.file)?;
            let (gateways, is_simulated) = open(arguments, context)?;
            let chosen = access::chosen(&*gateways, context.global.slave, arguments.all)?;
            if let Some(remark) = file.remark(is_simulated) {
                note(format_args!("ecan: {}: {remark}", file.path.display()));
            }
            ask(options, &file, &chosen)?;
            let said = "interrupted: stopping after the current gateway";
            let interrupt = Interrupt::install_with_message(said)?;
            let update = Update {
                gateways: &*gateways,
                file: &file,
                expected: options.expect_version.as_deref(),
                time_limit: Duration::from_secs(options.timeout.into()),
            };
            update_all(&update, &chosen, &interrupt, &context.output)
        }
    }
}

/// Opens the gateways; `true` if they are simulated.
fn open(arguments: &FirmwareArguments, context: &Context) -> Result<(Box<dyn Gateways>, bool)> {
    match (context.setting()?, &arguments.ethercat) {
        (EcrtSetting::Library(_), named) => {
            let tool = ByTool::open(named.as_deref(), context.global.master())?;
            let tool = match arguments.action {
                Action::Version => tool,
                Action::Update(_) => tool.shielded(),
            };
            Ok((Box::new(tool), false))
        }
        (EcrtSetting::Simulated(_), Some(_)) => {
            Err(Failure::Usage("--ethercat cannot be used with a simulated master".to_owned()))
        }
        (setting @ EcrtSetting::Simulated(_), None) => {
            let backend = context.backend(&setting, ClockKind::Stepped)?;
            let Some(simulation) = backend.simulation.clone() else {
                return Err(Failure::Master("the simulation cannot be accessed".to_owned()));
            };
            let bus = Bus::of(&backend, context.global.master(), context.global.slave)?;
            Ok((Box::new(Simulated { bus, simulation }), true))
        }
    }
}

fn version(gateways: &dyn Gateways, chosen: Selection, output: &Output) -> Result {
    let is_only = chosen.gateways.len() + chosen.unknown.len() == 1;
    let mut versions = Vec::new();
    for SlaveEntry { position, state, .. } in chosen.gateways {
        let (running, error) = match Running::read(gateways, position) {
            Ok(running) => (Some(running), None),
            // The others fail too, or there are none.
            Err(failure @ Failure::Master(_)) => return Err(failure),
            Err(failure) if is_only => return Err(failure),
            Err(failure) => (None, Some(failure.to_string())),
        };
        versions.push(Version { position, state, running, error });
    }
    for (SlaveEntry { position, state, .. }, unknown) in chosen.unknown {
        versions.push(Version { position, state, running: None, error: Some(unknown.text()) });
    }
    versions.sort_by_key(|version| version.position);
    output.data(&versions, |out| {
        output::print_with_titles(
            out,
            ["POS", "STATE", "FIRMWARE", "SERIAL"],
            &versions,
            |version| {
                let [firmware, serial] = match (&version.running, &version.error) {
                    (Some(running), _) => [running.to_string(), running.serial.to_string()],
                    (None, error) => {
                        let reason = error.as_deref().unwrap_or_default();
                        ["-".to_owned(), format!("not read: {reason}")]
                    }
                };
                [version.position.to_string(), version.state.clone(), firmware, serial]
            },
        )
    })?;
    let unread = versions.iter().filter(|version| version.running.is_none()).count();
    match unread {
        0 => Ok(()),
        unread => {
            let text = format!("{unread} of {} gateways were not read; see above", versions.len());
            Err(Failure::Rejected(text))
        }
    }
}

fn ask(options: &UpdateArguments, file: &FirmwareFile, chosen: &Selection) -> Result {
    let text = |slave: &SlaveEntry| format!("{} ({})", slave.position, slave.state);
    let slaves: Vec<_> = chosen.gateways.iter().map(text).collect();
    let question = format_args!(
        "Write {} ({} bytes) to slave {}? CAN traffic stops and the gateway restarts.",
        file.path.display(),
        file.bytes.len(),
        slaves.join(", ")
    );
    let is_granted = options.yes || chosen.gateways.is_empty();
    confirm(is_granted, "the update", question, "nothing written")
}

fn update_all(
    update: &Update<'_>,
    chosen: &Selection,
    interrupt: &Interrupt,
    output: &Output,
) -> Result {
    let mut reports: Vec<GatewayUpdate> = Vec::new();
    let mut is_interrupted = false;
    for slave in &chosen.gateways {
        let report = match reports.iter().find_map(GatewayUpdate::halts) {
            Some(reason) => GatewayUpdate::not_tried(slave.position, reason, true),
            None if interrupt.is_set() => {
                is_interrupted = true;
                GatewayUpdate::not_tried(
                    slave.position,
                    "interrupted before the update".to_owned(),
                    false,
                )
            }
            None => update.run(slave, reports.is_empty()),
        };
        if chosen.gateways.len() > 1 {
            output.progress(report.line());
        }
        reports.push(report);
    }
    let unknown = chosen.unknown.iter().map(|(_, slave)| slave);
    reports
        .extend(unknown.map(|slave| GatewayUpdate::not_tried(slave.position, slave.text(), false)));
    reports.sort_by_key(|report| report.position);
    let results: Vec<_> = reports
        .iter()
        .map(|report| UpdateReport { report, is_good: report.is_good(), text: report.text() })
        .collect();
    output.data(&results, |out| print(&reports, output, out))?;
    if let Some(GatewayUpdate { outcome: Outcome::Rejected { rejection }, .. }) =
        reports.iter().find(|report| report.is_about_host())
    {
        return Err(Failure::Master(rejection.to_string()));
    }
    let good = reports.iter().filter(|report| report.is_good()).count();
    let all = reports.len();
    let text = match (good, all) {
        (good, all) if good == all => return Ok(()),
        (_, 1) => "the gateway does not run the new firmware; see above".to_owned(),
        _ => format!("{} of {all} gateways do not run the new firmware; see above", all - good),
    };
    if reports.iter().any(GatewayUpdate::is_rejected) {
        Err(Failure::Rejected(text))
    } else if is_interrupted {
        Err(Failure::Incomplete(format!("interrupted: {text}")))
    } else {
        Err(Failure::ProblemsFound)
    }
}

fn print(reports: &[GatewayUpdate], output: &Output, out: &mut dyn Write) -> std::io::Result<()> {
    output::print_with_titles(out, ["POS", "BEFORE", "AFTER", "RESULT"], reports, |report| {
        let tone = match report.outcome {
            _ if report.is_good() => Tone::Good,
            Outcome::Unchanged { .. } => Tone::Warning,
            _ => Tone::Bad,
        };
        [
            report.position.to_string(),
            output::or_dash(report.before.as_ref()),
            output::or_dash(report.after.as_ref()),
            output.toned(tone, report.text()),
        ]
    })?;
    if reports.len() > 1 {
        let all = reports.len();
        let good = reports.iter().filter(|report| report.is_good()).count();
        writeln!(out, "{good} of {all} gateways run the new firmware")?;
    }
    Ok(())
}
