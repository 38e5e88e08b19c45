//! `ecan config diff`: compares the gateways with a file.

use std::path::Path;

use ecan_host::Expectation;
use ecan_lite::config::{Difference, Expected, ResolvedGateway, differences};
use serde::Serialize;

use crate::commands::serve;
use crate::config_file;
use crate::context::{Context, Failure, Result, Tone, note};
use crate::frames::GatewayRequirements;

#[derive(Debug, Serialize)]
struct Compared {
    position: usize,
    gateway: usize,
    /// `None` if not read because this or another gateway failed.
    differences: Option<Vec<Differing>>,
    error: Option<String>,
}

/// A value, or the condition of a readback.
#[derive(Debug, Serialize)]
#[serde(untagged)]
enum FileValue {
    Value(u64),
    Condition(String),
}

impl From<Expected> for FileValue {
    fn from(expected: Expected) -> Self {
        match expected {
            Expected::Value(value) => Self::Value(value.into()),
            Expected::Readback(Expectation::Equals(value)) => Self::Value(value),
            Expected::Readback(_) | Expected::Loaded => Self::Condition(expected.to_string()),
        }
    }
}

#[derive(Debug, Serialize)]
struct Differing {
    index: u16,
    subindex: u8,
    filter: Option<u8>,
    file: FileValue,
    /// `None` if the device lacks the entry.
    device: Option<u32>,
    is_set_at_start: bool,
    #[serde(skip)]
    words: String,
}

impl From<Difference> for Differing {
    fn from(difference: Difference) -> Self {
        let words = difference.to_string();
        let Difference { index, subindex, filter, expected, found, is_set_at_start } = difference;
        let file = expected.into();
        Self { index, subindex, filter, file, device: found, is_set_at_start, words }
    }
}

pub fn run(path: &Path, counts_active: bool, context: &Context) -> Result {
    let mut file = config_file::read(path)?;
    let (bus, resolved) = super::open_gateways(&file, context)?;
    if bus.service().is_some_and(|it| serve::keeps_gateways(it.hello())) {
        let requirements = GatewayRequirements::of_service();
        file.port.gateways.iter_mut().for_each(|it| requirements.apply(it));
    }
    let mut compared = Vec::new();
    let mut failed = None;
    for ResolvedGateway { gateway, slave: position } in resolved {
        let mut it = Compared { position, gateway, differences: None, error: None };
        if failed.is_none() {
            match differences(
                bus.diagnostics(),
                position,
                &ecan_lite::config::startup(&file, gateway),
            ) {
                Ok(found) => {
                    it.differences = Some(found.into_iter().map(Differing::from).collect());
                }
                Err(error) => {
                    it.error = Some(error.to_string());
                    failed = Some(Failure::Device(error));
                }
            }
        }
        compared.push(it);
    }
    let counts = |it: &&Differing| counts_active || !it.is_set_at_start;
    context.output.data(&compared, |out| {
        for Compared { position, differences, error, .. } in &compared {
            let Some(differences) = differences else {
                let why = error.as_deref().unwrap_or("skipped");
                let words = context.output.toned(Tone::Bad, format_args!("not compared: {why}"));
                writeln!(out, "slave {position}: {words}")?;
                continue;
            };
            for Differing { words, .. } in differences.iter().filter(counts) {
                writeln!(out, "slave {position}: {}", context.output.toned(Tone::Bad, words))?;
            }
        }
        Ok(())
    })?;
    let all = || compared.iter().filter_map(|it| it.differences.as_ref()).flatten();
    let (counted, total) = (all().filter(counts).count(), all().count());
    if total > counted {
        note(format_args!(
            "{} entries that the master writes at each start differ too (shown with --active)",
            total - counted
        ));
    }
    match failed {
        Some(failure) => Err(failure),
        None if counted == 0 => Ok(()),
        None => Err(Failure::ProblemsFound),
    }
}
