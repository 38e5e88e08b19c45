//! `ecan config apply`: writes a file to the gateways.

use std::io::Write;
use std::path::Path;

use ecan_config_file::{ResolvedGateway, apply};
use ecan_host::StartupStep;
use ecan_protocol::object::describe;
use serde::Serialize;

use crate::config_file;
use crate::context::{Context, Output, Result, Tone};

#[derive(Debug, Serialize)]
struct Applied {
    position: usize,
    gateway: usize,
    is_complete: bool,
    /// Reason of the failure; `None` if another gateway failed before.
    error: Option<String>,
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
    let (bus, resolved) = super::open_gateways(&file, context)?;
    let mut applied = Vec::new();
    let mut failed = None;
    for gateway in resolved {
        let mut done = Applied::nothing(gateway);
        if failed.is_none() {
            let steps = ecan_config_file::startup(&file, gateway.gateway);
            let written =
                apply(bus.diagnostics(), gateway.slave, &steps, &mut |step| done.note(step));
            failed = written.map_err(config_file::resolve_failure).err();
            done.is_complete = failed.is_none();
            done.error = failed.as_ref().map(ToString::to_string);
        }
        applied.push(done);
    }
    context.output.data(&applied, |out| {
        applied.iter().try_for_each(|it| it.print(path, with_steps, &context.output, out))
    })?;
    failed.map_or(Ok(()), Err)
}

impl Applied {
    fn nothing(ResolvedGateway { gateway, slave }: ResolvedGateway) -> Self {
        let (parts, steps) = (Vec::new(), Vec::new());
        Self { position: slave, gateway, is_complete: false, error: None, parts, steps }
    }

    fn print(
        &self,
        path: &Path,
        with_steps: bool,
        output: &Output,
        out: &mut dyn Write,
    ) -> std::io::Result<()> {
        let Self { position: slave, gateway, steps, .. } = self;
        let path = path.display();
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
        0x8030 => "diagnostic tests off".to_owned(),
        0x1C12 | 0x1C13 => "PDO assignment".to_owned(),
        0x8010 | 0x8011 => "PDO profiles".to_owned(),
        0x8001..=0x8004 if (43..=60).contains(&subindex) => {
            format!("filters of CAN{}", index - 0x8001)
        }
        0x8001..=0x8004 => format!("CAN{}", index - 0x8001),
        0x8021..=0x8024 => format!("data path of CAN{}", index - 0x8021),
        0x8020 => "data path".to_owned(),
        _ => format!("0x{index:04X}"),
    }
}
