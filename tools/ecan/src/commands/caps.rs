//! `ecan caps`: capabilities of a gateway (0xF000, manual 13.8).

use std::io::Write;

use ecan_protocol::device::{Capabilities, assumed_value};
use ecan_protocol::object::object;
use serde::Serialize;

use crate::context::{Context, Failure, Result};
use crate::readings::{Readings, not_read};
use crate::table;
use crate::value::Value;

#[derive(Debug, Serialize)]
struct Capability {
    position: usize,
    subindex: u8,
    name: &'static str,
    value: Option<u32>,
    meaning: Option<String>,
    error: Option<String>,
    /// Value that the SDK assumes for an entry that the gateway does not have.
    assumed: Option<u32>,
}

pub fn run(context: &Context) -> Result {
    let bus = context.bus()?;
    let slave = bus.slave()?;
    let entries = object(Capabilities::INDEX).map_or(&[][..], |object| object.entries);
    let (mut capabilities, mut readings) = (Vec::new(), Readings::default());
    for subindex in Capabilities::fields() {
        let value = bus.read(slave, Capabilities::INDEX, *subindex);
        let is_missing = matches!(&value, Err(Failure::Device(error)) if error.is_missing_object());
        let value = readings.note(value);
        readings.answers()?;
        let entry = entries.iter().find(|entry| entry.subindex == *subindex);
        capabilities.push(Capability {
            position: slave,
            subindex: *subindex,
            name: entry.map_or("", |entry| entry.name),
            meaning: value
                .as_ref()
                .ok()
                .and_then(|it| Value::Unsigned((*it).into()).meaning(entry)),
            error: value.as_ref().err().cloned(),
            value: value.ok(),
            assumed: assumed_value(Capabilities::INDEX, *subindex).filter(|_| is_missing),
        });
    }
    readings.any()?;
    context.output.data(&capabilities, |out| print(&capabilities, out))?;
    readings.end()
}

fn print(capabilities: &[Capability], out: &mut dyn Write) -> std::io::Result<()> {
    table::print(out, capabilities, |it| {
        let entry = object(Capabilities::INDEX).and_then(|object| object.entry(it.subindex));
        let value = match it.value {
            Some(value) => Value::Unsigned(value.into()).text(entry),
            None => match it.assumed {
                Some(assumed) => format!(
                    "not reported; assumed: {}",
                    Value::Unsigned(assumed.into()).text(entry)
                ),
                None => not_read(it.error.as_deref().unwrap_or_default()),
            },
        };
        let meaning = it.meaning.clone().unwrap_or_default();
        [format!(":{:02}", it.subindex), it.name.to_owned(), value, meaning]
    })
}
