//! `ecan config apply`: a file, written to the gateways.

use std::path::Path;

use ecan_config_file::apply;
use ecan_host::StartupStep;
use ecan_protocol::describe;
use serde::Serialize;

use crate::config_file;
use crate::failure::Failure;
use crate::global::GlobalOptions;
use crate::output::{Output, Tone};

/// What was done to a slave.
#[derive(Debug, Serialize)]
struct Applied {
    slave: usize,
    gateway: usize,
    parts: Vec<Part>,
    steps: Vec<String>,
}

/// A part of the sequence, in the order of the manual.
#[derive(Debug, Serialize)]
struct Part {
    name: String,
    writes: usize,
    readbacks: usize,
}

pub fn run(
    path: &Path,
    with_steps: bool,
    global: &GlobalOptions,
    output: &Output,
) -> Result<(), Failure> {
    let file = config_file::read(path)?;
    let (bus, places) = super::places(&file, global, output)?;
    let mut applied = Vec::new();
    for place in places {
        let mut done = Applied {
            slave: place.slave,
            gateway: place.gateway,
            parts: Vec::new(),
            steps: Vec::new(),
        };
        let steps = file.startup(place.gateway);
        apply(bus.diagnostics(), place.slave, &steps, &mut |step| done.note(step))
            .map_err(config_file::of_place)?;
        applied.push(done);
    }
    output.data(&applied, |out| {
        for Applied { slave, gateway, parts, steps } in &applied {
            let heading = format!("slave {slave} has gateway {gateway} of {}", path.display());
            writeln!(out, "{}", output.toned(Tone::Good, heading))?;
            for Part { name, writes, readbacks } in parts {
                writeln!(out, "  {name:<20} {writes:>3} written, {readbacks:>2} read back")?;
            }
            for step in steps.iter().filter(|_| with_steps) {
                writeln!(out, "    {step}")?;
            }
        }
        Ok(())
    })
}

impl Applied {
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
        0x8030 => "no diagnostic test".to_owned(),
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
