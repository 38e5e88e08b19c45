//! `ecan probe`: experiments that decide the assumptions about a gateway.

use std::collections::BTreeSet;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use clap::Args;
use ecan_host::CycleTiming;
use ecan_protocol::device::AlState;
use ecan_protocol::mapping::CHANNELS;
use ecan_tool_support::command_line::interrupt::Interrupt;
use ecan_tool_support::command_line::new_file;
use ecan_tool_support::command_line::options::RealTimeArguments;
use ecan_tool_support::command_line::run_info::RunInfo;
use ecan_tool_support::probe::{
    DeviceProfile, Experiment, Finding, Probe, ProbeOptions, Stage, Verdict,
};
use serde::Serialize;

use super::diag;
use super::saved_config::{Changes, Saved};
use super::selftest::Wiring;
use crate::context::{Bus, Context, Failure, Output, Result, Tone, note};
use crate::output::Progress;

pub const EXAMPLES: &str = "\
Examples:
  ecan probe                                  every stage but the last
  ecan probe --wired 0-1                      and frames between two wired channels
  ecan probe --read-only                      objects only, also while an application runs
  ecan probe --bundle probe-4711              write report, text and support bundle to a directory
  ecan probe --write-profile gateway.toml     write the measured values

The stages: reading; configuration in PREOP, with a restart; OP with images without frames;
loopback inside the CAN controller; frames between wired channels. No frame leaves a channel
before the last stage. A restart interrupts the slaves that are connected after the gateway.

The probe restores the configuration of the gateway, by a restart if necessary, also after
Ctrl-C. The Flash is not written. If the link is lost, the interrupted experiment is repeated
once. The rows are those of docs/ASSUMPTIONS.md. Real-time options let it resolve shorter times.

Exit status 0 if every decided assumption holds, 1 if one differs.";

#[derive(Debug, Args)]
pub struct ProbeArguments {
    /// Two channels that are wired to each other and alone on their bus, for example 0-1
    #[arg(long, value_name = "PAIR", conflicts_with = "read_only")]
    wired: Option<Wiring>,
    /// Read objects only: no restart, no configuration, no frames
    #[arg(long)]
    read_only: bool,
    /// Write report, text and support bundle to a new directory
    #[arg(long, value_name = "DIR")]
    bundle: Option<PathBuf>,
    /// Write the measured values to a file (TOML)
    #[arg(long, value_name = "FILE")]
    write_profile: Option<PathBuf>,
    #[command(flatten)]
    real_time: RealTimeArguments,
}

#[derive(Debug, Serialize)]
struct ProbeReport {
    program: String,
    date: String,
    kernel: String,
    command_line: String,
    position: usize,
    is_simulated: bool,
    was_stopped: bool,
    findings: Vec<Finding>,
    profile: DeviceProfile,
    /// Configuration after the probe.
    configuration: String,
    is_restored: bool,
}

pub fn run(arguments: &ProbeArguments, context: &Context) -> Result {
    let wired = wired(arguments)?;
    let interrupt = Interrupt::install_with_message("stopping after restoring the configuration")?;
    let bus = context.bus()?;
    bus.ecrt()?;
    let slave = bus.slave()?;
    if let Some(directory) = &arguments.bundle {
        std::fs::create_dir(directory)
            .map_err(|error| Failure::file("create", directory, error))?;
    }
    arguments.real_time.apply(|line| note(line))?;
    let request = Request {
        master: context.global.master(),
        wired,
        read_only: arguments.read_only,
        timing: arguments.real_time.timing(),
    };
    let report = probe_and_restore(&bus, slave, &request, &interrupt, progress)?;
    context.output.data(&report, |out| print_report(&report, &context.output, out))?;
    if let Some(path) = &arguments.write_profile {
        write_profile(&report.profile, path)?;
    }
    if let Some(directory) = &arguments.bundle {
        write_bundle(&report, &bus, directory, context)?;
    }
    if report.was_stopped {
        return Err(Failure::Incomplete("stopped before the end of the probe".to_owned()));
    }
    let differs = report.findings.iter().any(|finding| finding.verdict == Verdict::Differs);
    match report.is_restored && !differs {
        true => Ok(()),
        false => Err(Failure::ProblemsFound),
    }
}

/// The gateway is probed on the master with this index.
struct Request {
    master: u32,
    wired: Option<(u8, u8)>,
    read_only: bool,
    timing: CycleTiming,
}

/// Runs the experiments and restores the configuration.
fn probe_and_restore(
    bus: &Bus,
    slave: usize,
    request: &Request,
    interrupt: &Interrupt,
    progress: impl FnMut(&Experiment),
) -> Result<ProbeReport> {
    let (saved, reason) = save(bus, slave, request.read_only);
    let last_stage = if saved.is_some() { Stage::Wired } else { Stage::Reading };
    let flag = interrupt.clone();
    let stop = Arc::new(move || flag.is_set());
    let options =
        ProbeOptions { wired: request.wired, last_stage, reason, timing: request.timing, stop };
    let mut probe = Probe::open(bus.ecrt()?, request.master, slave, options)?;
    let findings = probe.run(progress);
    let restored = match &saved {
        Some(saved) if probe.has_changed() => restore(bus, saved),
        _ => Ok("not changed".to_owned()),
    };
    let run = RunInfo::of_this_run("ecan", env!("CARGO_PKG_VERSION"));
    Ok(ProbeReport {
        program: run.program().to_owned(),
        date: run.date().to_owned(),
        kernel: run.kernel().to_owned(),
        command_line: run.command_line().to_owned(),
        position: slave,
        is_simulated: bus.is_simulated(),
        was_stopped: interrupt.is_set(),
        findings,
        profile: probe.device_profile().clone(),
        is_restored: restored.is_ok(),
        configuration: restored.unwrap_or_else(|error| format!("not restored: {error}")),
    })
}

fn wired(arguments: &ProbeArguments) -> Result<Option<(u8, u8)>> {
    match arguments.wired.as_ref().map(Wiring::pairs) {
        None => Ok(None),
        Some([pair]) => Ok(Some(*pair)),
        Some(_) => Err(Failure::Usage("--wired takes one pair of channels".to_owned())),
    }
}

/// Reads the configuration that the probe restores; otherwise the reason why it only reads.
fn save(bus: &Bus, slave: usize, read_only: bool) -> (Option<Saved>, String) {
    if read_only {
        return (None, "not run with --read-only".to_owned());
    }
    if bus.diagnostics().al_state(slave).ok().flatten() != Some(AlState::PreOp) {
        return (None, "not run: the gateway is not in PREOP".to_owned());
    }
    // A restart would interrupt the line.
    let is_op = |other: &usize| {
        bus.diagnostics().al_state(*other).is_ok_and(|state| state == Some(AlState::Op))
    };
    if let Some(other) = (0..bus.diagnostics().slave_count()).find(is_op) {
        return (None, format!("not run: slave {other} is in OP, an application uses the bus"));
    }
    let _progress = Progress::show("reading the configuration");
    match Saved::read(bus, slave) {
        Ok(saved) => (Some(saved), String::new()),
        Err(error) => {
            (None, format!("not run: the configuration could not be read to restore it: {error}"))
        }
    }
}

fn restore(bus: &Bus, saved: &Saved) -> Result<String> {
    let _progress = Progress::show("restoring the configuration");
    let written = BTreeSet::new();
    let changes = Changes { tested: [true; CHANNELS], written: &written, is_unknown: true };
    Ok(match saved.restore(bus, &changes)? {
        true => "as before the probe, by a restart",
        false => "as before the probe",
    }
    .to_owned())
}

fn progress(experiment: &Experiment) {
    tracing::info!(rows = ?experiment.rows, "{}", experiment.assumption);
    crate::output::step();
}

fn write_profile(profile: &DeviceProfile, path: &Path) -> Result {
    let text =
        format!("# Measured by ecan probe {}\n{}", env!("CARGO_PKG_VERSION"), profile.to_toml());
    new_file::write(path, text).map_err(|error| Failure::file("write", path, error))
}

fn write_bundle(report: &ProbeReport, bus: &Bus, directory: &Path, context: &Context) -> Result {
    let write = |name: &str, bytes: Vec<u8>| {
        let path = directory.join(name);
        new_file::write(&path, bytes).map_err(|error| Failure::file("write", &path, error))
    };
    let json = serde_json::to_vec_pretty(report).map_err(std::io::Error::from)?;
    write("probe.json", json)?;
    let mut text = Vec::new();
    let ProbeReport { date, program, kernel, command_line, .. } = report;
    writeln!(
        text,
        "date: {date}\nprogram: {program}\nkernel: {kernel}\ncommand line: {command_line}\n"
    )?;
    print_report(report, &Output::new(false, crate::global::Color::Never), &mut text)?;
    write("probe.txt", text)?;
    diag::record(bus, report.position, &directory.join("diagnosis.json"), context)?;
    note(format_args!("written to {}", directory.display()));
    Ok(())
}

fn print_report(report: &ProbeReport, output: &Output, out: &mut dyn Write) -> std::io::Result<()> {
    match report.profile.serial {
        Some(serial) => writeln!(out, "gateway {serial} at position {}", report.position)?,
        None => writeln!(out, "gateway without a serial number at position {}", report.position)?,
    }
    for stage in Stage::ALL.into_iter().map(Some).chain([None]) {
        let mut of_stage =
            report.findings.iter().filter(|finding| finding.stage == stage).peekable();
        if of_stage.peek().is_some() {
            writeln!(out, "\n{}", stage.map_or("without an experiment", Stage::text))?;
        }
        for finding in of_stage {
            print_finding(finding, output, out)?;
        }
    }
    let count =
        |verdict| report.findings.iter().filter(|finding| finding.verdict == verdict).count();
    writeln!(
        out,
        "\n{} assumptions: {} hold, {} differ, {} undecided",
        report.findings.len(),
        count(Verdict::Holds),
        count(Verdict::Differs),
        count(Verdict::Undecided)
    )?;
    writeln!(out, "configuration: {}", report.configuration)
}

fn print_finding(finding: &Finding, output: &Output, out: &mut dyn Write) -> std::io::Result<()> {
    let verdict = match finding.verdict {
        Verdict::Holds => output.toned(Tone::Good, "holds    "),
        Verdict::Differs => output.toned(Tone::Bad, "DIFFERS  "),
        Verdict::Undecided => output.toned(Tone::Warning, "undecided"),
    };
    let rows = finding.rows.join(", ");
    writeln!(out, "  {verdict}  {rows:<8}  {}", finding.assumption)?;
    writeln!(out, "                       {}", finding.detail)
}

#[cfg(test)]
#[path = "probe_tests.rs"]
mod tests;
