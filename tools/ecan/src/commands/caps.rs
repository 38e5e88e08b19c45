//! `ecan caps`: 0xF000 in words (manual 13.8).

use std::io::Write;

use ecan_protocol::{Capabilities, object};
use serde::Serialize;

use crate::bus::Bus;
use crate::failure::Failure;
use crate::global::GlobalOptions;
use crate::output::Output;
use crate::table;
use crate::value::Value;

/// An entry of the capability object.
#[derive(Debug, Serialize)]
struct Capability {
    position: usize,
    subindex: u8,
    name: &'static str,
    value: u32,
    meaning: Option<String>,
}

pub fn run(global: &GlobalOptions, output: &Output) -> Result<(), Failure> {
    let bus = Bus::open(global, output)?;
    let slave = bus.slave()?;
    let entries = object(Capabilities::INDEX).map_or(&[][..], |object| object.entries);
    let mut capabilities = Vec::new();
    for subindex in Capabilities::fields() {
        let upload = bus.diagnostics().sdo_upload_u32(slave, Capabilities::INDEX, *subindex);
        let value = upload.map_err(Failure::Device)?;
        let entry = entries.iter().find(|entry| entry.subindex == *subindex);
        capabilities.push(Capability {
            position: slave,
            subindex: *subindex,
            name: entry.map_or("", |entry| entry.name),
            value,
            meaning: Value::Unsigned(value.into()).meaning(entry),
        });
    }
    output.data(&capabilities, |out| print(&capabilities, out))
}

fn print(capabilities: &[Capability], out: &mut dyn Write) -> std::io::Result<()> {
    let rows: Vec<_> = capabilities
        .iter()
        .map(|it| {
            let entry = object(Capabilities::INDEX).and_then(|object| object.entry(it.subindex));
            let value = Value::Unsigned(it.value.into()).text(entry);
            [format!(":{:02}", it.subindex), it.name.to_owned(), value, words(&it.meaning)]
        })
        .collect();
    table::print(out, &rows)
}

fn words(meaning: &Option<String>) -> String {
    meaning.clone().unwrap_or_default()
}
