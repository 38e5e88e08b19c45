//! `ecan config apply`: writes a file to the gateways.

use std::io::Write;
use std::path::Path;

use ecan_host::{Diagnostics, StartupStep};
use ecan_lite::config::{ResolvedGateway, apply, missing_entries};
use ecan_mcan_port::Config;
use ecan_protocol::device::OptionalObject;
use ecan_protocol::object::describe;
use ecan_protocol::text::Printable;
use ecan_sim::ClockKind;
use serde::Serialize;

use crate::config_changes::{ConfigText, ReadyGateway, Report};
use crate::context::{Bus, Context, Failure, Output, Result, Tone};
use crate::service_access::ServiceConnection;
use crate::{config_changes, config_file};

#[derive(Debug, Serialize)]
pub(super) struct Applied {
    position: usize,
    gateway: usize,
    is_complete: bool,
    /// Reason of the failure; `None` if another gateway failed before.
    error: Option<String>,
    /// Optional entries that the gateway lacks; they were not written.
    lacking: Vec<String>,
    parts: Vec<Part>,
    steps: Vec<String>,
}

/// Part of the sequence, in the order of the manual.
#[derive(Debug, Serialize)]
struct Part {
    name: String,
    writes: usize,
    readbacks: usize,
}

pub fn run(path: &Path, with_steps: bool, context: &Context) -> Result {
    let file = config_file::read(path)?;
    let bus = config_file::open_bus(&file, context, ClockKind::Stepped)?;
    if let Some(connection) = bus.service()
        && let Some(report) = through_service(connection, path, with_steps, context)?
    {
        return context
            .output
            .data(&report, |out| print_report(&report, path, &context.output, out));
    }
    let resolved = config_file::resolve(&file, &bus)?;
    let mut applied: Vec<_> = resolved.into_iter().map(Applied::nothing).collect();
    let failed = write_all(bus.diagnostics(), &file, &mut applied).err();
    context.output.data(&applied, |out| {
        applied.iter().try_for_each(|applied| applied.print(path, with_steps, &context.output, out))
    })?;
    match failed {
        Some(failure) => Err(failure),
        None if applied.iter().all(|applied| applied.lacking.is_empty()) => Ok(()),
        None => Err(Failure::ProblemsFound),
    }
}

/// Configures the gateways through a service that keeps them ready; `None` if it runs no cycle.
fn through_service(
    connection: &ServiceConnection,
    path: &Path,
    with_steps: bool,
    context: &Context,
) -> Result<Option<Report>> {
    let has_cycle = connection.hello().cycle_ns.is_some();
    let is_whole = !with_steps && context.global.slave.is_none();
    if has_cycle && !is_whole {
        let message = "--steps and --slave are not used here: the service configures all gateways of \
                       the file";
        return Err(Failure::Usage(message.to_owned()));
    }
    let report = match is_whole {
        true => config_changes::request(connection, &ConfigText::read(path)?)?,
        false => None,
    };
    if has_cycle && report.is_none() {
        return Err(Failure::Rejected(format!(
            "{} does not permit another configuration: it has configured the gateways and runs their \
             cycle; change the configuration of that program and restart it",
            connection.program()
        )));
    }
    Ok(report)
}

fn print_report(
    report: &Report,
    path: &Path,
    output: &Output,
    out: &mut dyn Write,
) -> std::io::Result<()> {
    for ReadyGateway { position, gateway } in &report.gateways {
        let text = format!(
            "slave {position}: configured as gateway {gateway} of {}",
            Printable(path.display())
        );
        writeln!(out, "{}", output.toned(Tone::Good, text))?;
    }
    report.changes.iter().try_for_each(|change| writeln!(out, "  {change}"))?;
    if report.changes.is_empty() {
        writeln!(out, "  no setting differs from the former configuration")?;
    }
    let label = output.toned(Tone::Warning, "warning:");
    report.warnings.iter().try_for_each(|warning| writeln!(out, "{label} {warning}"))
}

/// Writes the file to one gateway.
pub(super) fn write_gateway(
    bus: &Bus,
    file: &Config,
    gateway: ResolvedGateway,
) -> (Applied, Result) {
    let mut applied = Applied::nothing(gateway);
    let written = write_all(bus.diagnostics(), file, std::slice::from_mut(&mut applied));
    (applied, written)
}

/// Writes to the gateways, up to the first failure, after it has examined all of them.
fn write_all(bus: &Diagnostics, file: &Config, applied: &mut [Applied]) -> Result {
    let mut steps = Vec::new();
    for done in &mut *applied {
        let mut of_gateway = ecan_lite::config::startup(file, done.gateway);
        let examined = leave_out_lacking(bus, done.position, &mut of_gateway, done);
        done.record_error(examined)?;
        steps.push(of_gateway);
    }
    for (done, steps) in applied.iter_mut().zip(steps) {
        let written = apply(bus, done.position, &steps, &mut |step| done.note(step));
        done.record_error(written.map_err(config_file::resolve_failure))?;
        done.is_complete = true;
    }
    Ok(())
}

/// Removes the steps of optional objects that the gateway lacks, as the start of a Port does. Fails
/// if it lacks another entry.
fn leave_out_lacking(
    bus: &Diagnostics,
    slave: usize,
    steps: &mut Vec<StartupStep>,
    done: &mut Applied,
) -> Result {
    let missing = missing_entries(bus, slave, steps).map_err(Failure::Device)?;
    let text = |(index, subindex): &(u16, u8)| describe(*index, *subindex).to_string();
    let (optional, needed): (Vec<_>, Vec<_>) = missing
        .into_iter()
        .partition(|(index, subindex)| OptionalObject::of(*index, *subindex).is_some());
    if !needed.is_empty() {
        let texts: Vec<_> = needed.iter().map(text).collect();
        return Err(Failure::Rejected(format!(
            "slave {slave}: the firmware lacks {} (assumption H42); nothing was written; update the \
             firmware, or leave their keys out of the file",
            texts.join(", ")
        )));
    }
    let lacking = |(index, subindex): (u16, u8)| OptionalObject::of(index, subindex);
    let objects: Vec<_> = optional.iter().copied().filter_map(lacking).collect();
    steps.retain(|step| !lacking(step.object()).is_some_and(|object| objects.contains(&object)));
    done.lacking = optional.iter().map(text).collect();
    Ok(())
}

impl Applied {
    fn nothing(ResolvedGateway { gateway, slave }: ResolvedGateway) -> Self {
        let (parts, steps) = (Vec::new(), Vec::new());
        let lacking = Vec::new();
        Self { position: slave, gateway, is_complete: false, error: None, lacking, parts, steps }
    }

    fn record_error(&mut self, result: Result) -> Result {
        self.error = result.as_ref().err().map(ToString::to_string);
        result
    }

    /// Returns whether everything was written.
    pub(super) fn is_complete(&self) -> bool {
        self.is_complete
    }

    pub(super) fn print(
        &self,
        path: &Path,
        with_steps: bool,
        output: &Output,
        out: &mut dyn Write,
    ) -> std::io::Result<()> {
        let Self { position: slave, gateway, steps, .. } = self;
        let path = Printable(path.display());
        let (tone, has) = match (self.is_complete, &self.error) {
            (true, _) => (Tone::Good, "configured as"),
            (false, Some(_)) if !steps.is_empty() => (Tone::Bad, "partially configured as"),
            (false, Some(_)) => (Tone::Bad, "not configured as"),
            (false, None) => (Tone::Warning, "skipped, not configured as"),
        };
        let heading = format!("slave {slave}: {has} gateway {gateway} of {path}");
        writeln!(out, "{}", output.toned(tone, heading))?;
        for Part { name, writes, readbacks } in &self.parts {
            writeln!(out, "  {name:<20} {writes:>3} written, {readbacks:>2} read back")?;
        }
        steps.iter().filter(|_| with_steps).try_for_each(|step| writeln!(out, "    {step}"))?;
        for entry in &self.lacking {
            writeln!(out, "  not written: {entry}: the firmware lacks it (assumption H42)")?;
        }
        match &self.error {
            Some(error) => writeln!(out, "  {error}"),
            None => Ok(()),
        }
    }

    fn note(&mut self, step: &StartupStep) {
        let name = part_of(step);
        let at = self.parts.iter().position(|part| part.name == name).unwrap_or_else(|| {
            self.parts.push(Part { name, writes: 0, readbacks: 0 });
            self.parts.len() - 1
        });
        if let Some(part) = self.parts.get_mut(at) {
            let counter = if step.is_download() { &mut part.writes } else { &mut part.readbacks };
            *counter += 1;
        }
        self.steps.push(match step {
            StartupStep::Download(write) => write.to_string(),
            StartupStep::Expect { index, subindex, expected } => {
                format!("{} reads {expected}", describe(*index, *subindex))
            }
        });
    }
}

fn part_of(step: &StartupStep) -> String {
    let (index, subindex) = step.object();
    match index {
        0xF000 => "abilities".to_owned(),
        0x8000 => "system".to_owned(),
        0xB000 => "maintenance".to_owned(),
        0x8030 => "diagnostic tests off".to_owned(),
        0x1C12 | 0x1C13 => "PDO assignment".to_owned(),
        0x8010 | 0x8011 => "PDO profiles".to_owned(),
        0x8001..=0x8004 if (43..=60).contains(&subindex) => {
            format!("filters of CAN{}", index - 0x8001)
        }
        0x8001..=0x8004 => format!("CAN{}", index - 0x8001),
        0x8021..=0x8024 => format!("data path of CAN{}", index - 0x8021),
        0x8020 => "data path".to_owned(),
        _ => format!("object 0x{index:04X}"),
    }
}
