//! `ecan probe`: experiments that decide the assumptions about a gateway.

use std::collections::BTreeSet;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use clap::Args;
use ecan_host::CycleTiming;
use ecan_protocol::device::AlState;
use ecan_protocol::mapping::CHANNELS;
use ecan_protocol::text::Printable;
use ecan_tool_support::command_line::interrupt::Interrupt;
use ecan_tool_support::command_line::new_file::{self, Existing, WholeFile};
use ecan_tool_support::command_line::options::RealTimeArguments;
use ecan_tool_support::command_line::run_info::RunInfo;
use ecan_tool_support::probe::{
    DeviceProfile, Experiment, Finding, Probe, ProbeOptions, Stage, Verdict,
};
use serde::Serialize;
use serde_json::json;

use super::saved_config::{Changes, Saved};
use super::selftest::{GatewayReport, Wiring};
use super::{diag, selftest};
use crate::context::{Bus, Context, Failure, Output, Result, Tone, note};
use crate::output::{Progress, confirm};

pub const EXAMPLES: &str = "\
Examples:
  ecan probe                                  every stage but the last
  ecan probe --wired 0-1                      and frames between two wired channels
  ecan probe --read-only                      objects only, also while an application runs
  ecan probe --report gateway.json            and `ecan selftest`, with one report to send in
  ecan probe --write-profile gateway.toml     write the measured values

It asks before it writes to the gateway. The stages: reading; configuration in PREOP, with a restart; OP with images without frames;
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
    #[arg(long, conflicts_with = "yes")]
    read_only: bool,
    /// Do not ask before the gateway is configured and restarted
    #[arg(long)]
    yes: bool,
    /// Test the gateway as `ecan selftest`, and write all results with a support bundle to a file (JSON)
    #[arg(long, value_name = "FILE")]
    report: Option<PathBuf>,
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
    /// With `--report`.
    selftest: Option<GatewayReport>,
}

impl ProbeReport {
    fn is_good(&self) -> bool {
        self.is_restored
            && self.findings.iter().all(|finding| finding.verdict != Verdict::Differs)
            && self.selftest.as_ref().is_none_or(|selftest| selftest.is_good)
    }
}

pub fn run(arguments: &ProbeArguments, context: &Context) -> Result {
    if arguments.wired.as_ref().is_some_and(|wiring| wiring.pairs().len() != 1) {
        return Err(Failure::Usage("--wired takes one pair of channels".to_owned()));
    }
    let interrupt = Interrupt::install_with_message("stopping after restoring the configuration")?;
    let bus = context.bus()?;
    bus.ecrt()?;
    let slave = bus.slave()?;
    let file = |path: &PathBuf| {
        WholeFile::create(path, Existing::Keep).map_err(|error| Failure::file("write", path, error))
    };
    let file = arguments.report.as_ref().map(file).transpose()?;
    let is_granted = arguments.yes || arguments.read_only || bus.is_simulated();
    let question = format_args!(
        "Configure and restart slave {slave} for the experiments? This interrupts what is connected after it; its \
         configuration is restored."
    );
    confirm(is_granted, "the experiments", question, "nothing written")?;
    arguments.real_time.apply(|line| note(line))?;
    let request = Request {
        master: context.global.master(),
        wiring: arguments.wired.clone(),
        read_only: arguments.read_only,
        has_selftest: file.is_some(),
        timing: arguments.real_time.timing(),
    };
    let probed = probe_and_restore(&bus, slave, &request, &interrupt, progress);
    let written = file.zip(arguments.report.as_deref()).map(|(file, path)| {
        write_report(&probed, &bus, slave, file, context)
            .map_err(|error| Failure::file("write", path, error))
            .map(|()| path)
    });
    let report = match (probed, &written) {
        (Err(failure), Some(Ok(path))) => {
            let path = path.to_path_buf();
            return Err(Failure::Recorded { failure: Box::new(failure), path });
        }
        (probed, _) => probed?,
    };
    context.output.data(&report, |out| print_report(&report, &context.output, out))?;
    if let Some(path) = written.transpose()? {
        note(format_args!("written to {}", Printable(path.display())));
    }
    if let Some(path) = &arguments.write_profile {
        write_profile(&report.profile, path)?;
    }
    if report.was_stopped {
        return Err(Failure::Incomplete("stopped before the end of the probe".to_owned()));
    }
    match report.is_good() {
        true => Ok(()),
        false => Err(Failure::ProblemsFound),
    }
}

/// The gateway is probed on the master with this index.
struct Request {
    master: u32,
    wiring: Option<Wiring>,
    read_only: bool,
    has_selftest: bool,
    timing: CycleTiming,
}

/// Runs the experiments, restores the configuration, and tests the gateway if requested.
fn probe_and_restore(
    bus: &Bus,
    slave: usize,
    request: &Request,
    interrupt: &Interrupt,
    progress: impl FnMut(&Experiment),
) -> Result<ProbeReport> {
    let (saved, reason) = save(bus, slave, request.read_only);
    let last_stage = if saved.is_some() { Stage::Wired } else { Stage::Reading };
    let wired = request.wiring.as_ref().and_then(|wiring| wiring.pairs().first().copied());
    let flag = interrupt.clone();
    let stop = Arc::new(move || flag.is_set());
    let options =
        ProbeOptions { wired, last_stage, reason: reason.clone(), timing: request.timing, stop };
    let mut probe = Probe::open(bus.ecrt()?, request.master, slave, options)?;
    let findings = probe.run(progress);
    let restored = match &saved {
        Some(saved) if probe.has_changed() => restore(bus, saved),
        _ => Ok("not changed".to_owned()),
    };
    let profile = probe.device_profile().clone();
    drop(probe);
    let selftest = request.has_selftest.then(|| match &saved {
        None => GatewayReport::without_test(slave, &reason),
        Some(_) if restored.is_err() => GatewayReport::without_test(slave, "not restored"),
        Some(_) => selftest::test_one(bus, slave, request.wiring.clone(), interrupt),
    });
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
        profile,
        is_restored: restored.is_ok(),
        configuration: restored.unwrap_or_else(|error| format!("not restored: {error}")),
        selftest,
    })
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

/// Writes the report of a probe, or its failure, with a support bundle.
fn write_report(
    probed: &Result<ProbeReport>,
    bus: &Bus,
    slave: usize,
    file: WholeFile,
    context: &Context,
) -> std::io::Result<()> {
    let failure = probed.as_ref().err().map(ToString::to_string);
    let diagnosis = diag::gather(bus, slave, failure, context);
    let document = json!({ "probe": probed.as_ref().ok(), "diagnosis": diagnosis });
    file.finish(format!("{document:#}\n").as_bytes())
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
    if let Some(selftest) = &report.selftest {
        writeln!(out, "\nselftest")?;
        selftest.print(output, out)?;
    }
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
mod tests {
    use super::*;
    use ecan_sim::ClockKind;
    use ecan_sim::SimOptions;

    fn bus() -> Bus {
        let options = SimOptions { clock: Some(ClockKind::Stepped), ..SimOptions::default() };
        let backend = ecan_sim::open_scenario(ecan_sim::echo(1), &options).unwrap();
        Bus::over(&backend.ecrt)
    }

    fn request() -> Request {
        Request {
            master: 0,
            wiring: None,
            read_only: false,
            has_selftest: false,
            timing: CycleTiming::default(),
        }
    }

    /// Every setting of the gateway, with what is active.
    fn everything(bus: &Bus) -> String {
        format!("{:?}", Saved::read(bus, 0).unwrap())
    }

    /// Channel 1 active, other values not applied.
    fn configure(bus: &Bus) {
        for (index, subindex, value) in [(0x8002, 19, 800_000), (0x8002, 1, 1), (0x8003, 36, 2)] {
            bus.write(0, index, subindex, value).unwrap();
        }
    }

    fn of_verdict(report: &ProbeReport, verdict: Verdict) -> usize {
        report.findings.iter().filter(|finding| finding.verdict == verdict).count()
    }

    #[test]
    fn configuration_is_restored() {
        for is_configured in [false, true] {
            let bus = bus();
            if is_configured {
                configure(&bus);
            }
            let before = everything(&bus);
            let report =
                probe_and_restore(&bus, 0, &request(), &Interrupt::default(), |_| ()).unwrap();
            assert_eq!(of_verdict(&report, Verdict::Differs), 0, "{:#?}", report.findings);
            assert!(report.is_restored, "{}", report.configuration);
            assert_eq!(everything(&bus), before);
        }
    }

    #[test]
    fn stopped_probe_restores_at_every_experiment() {
        let count = ecan_tool_support::probe::experiments().count();
        for stopped_at in (0..count).step_by(5) {
            let bus = bus();
            configure(&bus);
            let before = everything(&bus);
            let interrupt = Interrupt::default();
            let mut begun = 0;
            let stop = |_: &Experiment| {
                if begun == stopped_at {
                    interrupt.request();
                }
                begun += 1;
            };
            let report = probe_and_restore(&bus, 0, &request(), &interrupt, stop).unwrap();
            assert!(report.was_stopped && report.is_restored, "{}", report.configuration);
            let stopped =
                report.findings.iter().filter(|finding| finding.detail == "stopped before the end");
            assert_eq!(stopped.count(), count - stopped_at);
            assert_eq!(everything(&bus), before, "stopped at {stopped_at}");
        }
    }

    #[test]
    fn read_only_probe_changes_nothing() {
        let bus = bus();
        configure(&bus);
        let before = everything(&bus);
        let request = Request { read_only: true, ..request() };
        let report = probe_and_restore(&bus, 0, &request, &Interrupt::default(), |_| ()).unwrap();
        assert_eq!(report.configuration, "not changed");
        assert!(of_verdict(&report, Verdict::Holds) > 0);
        let others = report.findings.iter().filter(|finding| finding.stage > Some(Stage::Reading));
        assert!(others.clone().all(|other| other.detail == "not run with --read-only"));
        assert_eq!(everything(&bus), before);
    }
}
