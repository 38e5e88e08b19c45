//! `ecan config diff`: the gateways against a file.

use std::path::Path;

use ecan_config_file::{Difference, differences};
use serde::Serialize;

use crate::config_file;
use crate::failure::Failure;
use crate::global::GlobalOptions;
use crate::output::{Output, Tone};

#[derive(Debug, Serialize)]
struct Compared {
    slave: usize,
    gateway: usize,
    differences: Vec<Differing>,
}

#[derive(Debug, Serialize)]
struct Differing {
    index: u16,
    subindex: u8,
    filter: Option<u8>,
    file: String,
    device: u32,
    is_set_at_start: bool,
    #[serde(skip)]
    words: String,
}

impl From<Difference> for Differing {
    fn from(difference: Difference) -> Self {
        let words = difference.to_string();
        let Difference { index, subindex, filter, expected, found, is_set_at_start } = difference;
        let file = expected.to_string();
        Self { index, subindex, filter, file, device: found, is_set_at_start, words }
    }
}

pub fn run(
    path: &Path,
    counts_active: bool,
    global: &GlobalOptions,
    output: &Output,
) -> Result<(), Failure> {
    let file = config_file::read(path)?;
    let (bus, places) = super::places(&file, global, output)?;
    let mut compared = Vec::new();
    for place in places {
        let steps = file.startup(place.gateway);
        let found = differences(bus.diagnostics(), place.slave, &steps).map_err(Failure::Device)?;
        let differences = found.into_iter().map(Differing::from).collect();
        compared.push(Compared { slave: place.slave, gateway: place.gateway, differences });
    }
    let counts = |it: &&Differing| counts_active || !it.is_set_at_start;
    output.data(&compared, |out| {
        for Compared { slave, differences, .. } in &compared {
            for Differing { words, .. } in differences.iter().filter(counts) {
                writeln!(out, "slave {slave}: {}", output.toned(Tone::Bad, words))?;
            }
        }
        Ok(())
    })?;
    let all = || compared.iter().flat_map(|it| &it.differences);
    let (counted, total) = (all().filter(counts).count(), all().count());
    if total > counted {
        output.note(format_args!(
            "{} entries that the master sets up at each start differ too (--active shows them)",
            total - counted
        ));
    }
    if counted == 0 { Ok(()) } else { Err(Failure::Amiss) }
}
