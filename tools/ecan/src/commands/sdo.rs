//! `ecan sdo`: access to objects by number or name.

use std::io::Write;

use clap::builder::{PossibleValuesParser, TypedValueParser};
use clap::{Args, Subcommand};
use ecan_protocol::object::{
    Access, Entry, Object, ObjectType, WriteResult, describe, object, objects,
};
use serde::Serialize;

use crate::context::{Bus, Context, Failure, Output, Result};
use crate::object_path::ObjectPath;
use crate::output;
use crate::value::{Readings, Value, encode, not_read};

#[derive(Debug, Args)]
#[command(after_help = "\
An object is INDEX:SUBINDEX, or OBJECT:ENTRY with (parts of) the names of the manual; OBJECT@N selects
one object of a family. ENTRY alone is sufficient if only one object has it.
  ecan sdo read 0x8010:3
  ecan sdo read 'device objects:serial number low'
  ecan sdo read 'maintenance status'
  ecan sdo write 'device maintenance:access mode request' engineering
  ecan sdo list 'channel config@0'
  ecan sdo list 0x8010:3 --names")]
pub struct SdoArguments {
    #[command(subcommand)]
    action: Action,
}

#[derive(Debug, Subcommand)]
enum Action {
    /// Read an object
    Read {
        /// Object
        object: ObjectPath,
    },
    /// Write an object and read it again; names of values are accepted
    Write {
        /// Object
        object: ObjectPath,
        /// Value
        value: String,
        /// Type of an object that is not in the table
        #[arg(long = "type", value_parser = type_parser())]
        ty: Option<ObjectType>,
    },
    /// List all objects, or the entries of one object with their values
    List {
        /// Object, or part of its name [default: all]
        object: Option<String>,
        /// List names only, without reading values
        #[arg(long)]
        names: bool,
    },
}

fn type_parser() -> impl TypedValueParser<Value = ObjectType> {
    use ObjectType::{I32, U8, U16, U32, VisibleString};
    let types = [("u8", U8), ("u16", U16), ("u32", U32), ("i32", I32), ("string", VisibleString)];
    PossibleValuesParser::new(types.map(|(name, _)| name))
        .map(move |name| types.iter().find(|known| known.0 == name).map_or(U8, |known| known.1))
}

#[derive(Debug, Default, Serialize)]
struct Read {
    position: usize,
    index: u16,
    subindex: u8,
    name: Option<&'static str>,
    access: Option<&'static str>,
    bytes: Option<Vec<u8>>,
    value: Option<Value>,
    text: Option<String>,
    meaning: Option<String>,
    error: Option<String>,
}

/// A written value, and what the gateway has then.
#[derive(Debug, Serialize)]
struct Written {
    #[serde(flatten)]
    read: Read,
    written: Value,
    /// Status that the gateway sets for the write; `None` if the object has none.
    status: Option<Status>,
}

#[derive(Debug, Serialize)]
struct Status {
    subindex: u8,
    value: u32,
    text: String,
}

#[derive(Debug, Serialize)]
struct Listed {
    index: u16,
    count: u16,
    name: &'static str,
    chapter: &'static str,
}

pub fn run(arguments: &SdoArguments, context: &Context) -> Result {
    match &arguments.action {
        Action::Read { object } => {
            let bus = context.bus()?;
            let read = read(&bus, bus.slave()?, *object)?;
            context.output.data(&read, |out| print_read(&read, out))
        }
        Action::Write { object, value, ty } => write(*object, value, *ty, context),
        Action::List { object: None, .. } => list_objects(objects(), &context.output),
        Action::List { object: Some(name), names } => list(name, *names, context),
    }
}

fn access(entry: &Entry) -> &'static str {
    match entry.access {
        Access::Ro => "ro",
        Access::Rw => "rw",
        Access::Wo => "wo",
    }
}

fn entry_of(path: ObjectPath) -> Option<&'static Entry> {
    object(path.index).and_then(|object| object.entry(path.subindex))
}

fn read(bus: &Bus, slave: usize, path: ObjectPath) -> Result<Read> {
    let ObjectPath { index, subindex } = path;
    let mut data = [0; 1024];
    let upload = bus.diagnostics().sdo_upload(slave, index, subindex, &mut data);
    let length = upload?;
    let bytes = data.get(..length).unwrap_or_default().to_vec();
    let entry = entry_of(path);
    let value = Value::of(&bytes, entry);
    Ok(Read {
        position: slave,
        index,
        subindex,
        name: entry.map(|entry| entry.name),
        access: entry.map(access),
        text: Some(value.text(entry)),
        meaning: value.meaning(entry),
        value: Some(value),
        bytes: Some(bytes),
        error: None,
    })
}

fn print_read(read: &Read, out: &mut dyn Write) -> std::io::Result<()> {
    let value = read.text.as_deref().unwrap_or_default();
    write!(out, "{} = {value}", describe(read.index, read.subindex))?;
    match &read.meaning {
        Some(meaning) => writeln!(out, ": {meaning}"),
        None => writeln!(out),
    }
}

fn write(path: ObjectPath, text: &str, ty: Option<ObjectType>, context: &Context) -> Result {
    let ObjectPath { index, subindex } = path;
    let data = encode(text, entry_of(path), ty).map_err(|error| {
        let is_swapped =
            |object: &ObjectPath| entry_of(path).is_none() && entry_of(*object).is_some();
        let hint = match text.parse().is_ok_and(|object| is_swapped(&object)) {
            true => "; the value follows the object",
            false => "",
        };
        Failure::Usage(format!("{}: {error}{hint}", describe(index, subindex)))
    })?;
    let bus = context.bus()?;
    let slave = bus.slave()?;
    let entry = entry_of(path);
    let result = entry.and_then(|entry| object(index)?.result_of(entry));
    let sequence = result.and_then(|result| result.sequence);
    let before = sequence.and_then(|sequence| bus.read(slave, index, sequence).ok());
    bus.diagnostics().sdo_download(slave, index, subindex, &data).map_err(Failure::Device)?;
    let status = result.and_then(|result| status(&bus, slave, index, (result, before)));
    let written = Value::of(&data, entry);
    let answer = match entry.is_none_or(|entry| entry.access.can_read()) {
        true => read(&bus, slave, path).map_err(|error| not_read(&error.to_string())),
        false => Err(WRITE_ONLY.to_owned()),
    };
    let read = answer.unwrap_or_else(|reason| Read::missing(slave, path, Some(reason)));
    let written = Written { read, written, status };
    context.output.data(&written, |out| print_written(&written, entry, out))?;
    if let Some(status) = written.rejection() {
        return Err(Failure::Rejected(format!(
            "{}: not accepted: {} reads {}",
            describe(index, subindex),
            describe(index, status.subindex),
            status.text
        )));
    }
    match written.is_changed(entry) {
        true => Err(Failure::Rejected(format!(
            "{} has another value after the write; the gateway limits or ignores it",
            describe(index, subindex)
        ))),
        false => Ok(()),
    }
}

/// Time that a command may take, and interval of reading its sequence number, in nanoseconds.
const COMMAND_NS: u64 = 10_000_000_000;
const POLL_NS: u64 = 20_000_000;

/// The status of a write, after the end of a command with a sequence number; `None` if it cannot be read.
fn status(
    bus: &Bus,
    slave: usize,
    index: u16,
    (result, before): (WriteResult, Option<u32>),
) -> Option<Status> {
    let clock = bus.clock();
    let deadline_ns = clock.now_ns().saturating_add(COMMAND_NS);
    while let Some(sequence) = result.sequence
        && bus.read(slave, index, sequence).ok()? == before?
        && clock.now_ns() < deadline_ns
    {
        clock.sleep_until_ns(clock.now_ns().saturating_add(POLL_NS));
    }
    let subindex = result.status;
    let value = bus.read(slave, index, subindex).ok()?;
    let meaning = object(index)?.entry(subindex)?.meaning(value);
    let text = meaning.map_or(value.to_string(), |meaning| format!("{value} ({meaning})"));
    Some(Status { subindex, value, text })
}

impl Written {
    /// The status of a write that the gateway did not accept.
    fn rejection(&self) -> Option<&Status> {
        self.status.as_ref().filter(|status| status.value != 0)
    }

    /// Returns whether a setting has another value than the written one. Commands and requests may.
    fn is_changed(&self, entry: Option<&Entry>) -> bool {
        let is_setting = entry.is_some_and(|entry| entry.key.is_some());
        is_setting && self.read.value.as_ref() != Some(&self.written)
    }
}

const WRITE_ONLY: &str = "write-only";

fn print_written(
    written: &Written,
    entry: Option<&Entry>,
    out: &mut dyn Write,
) -> std::io::Result<()> {
    let rejection = written.rejection();
    let Written { read, written, .. } = written;
    if let Some(status) = rejection {
        let name = describe(read.index, read.subindex);
        let found = describe(read.index, status.subindex);
        return writeln!(
            out,
            "{name}: {} written, not accepted: {found} = {}",
            written.text(entry),
            status.text
        );
    }
    match &read.error {
        None if read.value.as_ref() == Some(written) => print_read(read, out),
        None => {
            let name = describe(read.index, read.subindex);
            writeln!(out, "{name}: {} written", written.text(entry))?;
            print_read(read, out)
        }
        Some(reason) => {
            let name = describe(read.index, read.subindex);
            writeln!(out, "{name}: {} written, {reason}", written.text(entry))
        }
    }
}

impl Read {
    /// An entry without value.
    fn missing(position: usize, path: ObjectPath, error: Option<String>) -> Self {
        let entry = entry_of(path);
        Self {
            position,
            index: path.index,
            subindex: path.subindex,
            name: entry.map(|entry| entry.name),
            access: entry.map(access),
            error,
            ..Self::default()
        }
    }
}

fn list_objects(objects: &[&'static Object], output: &Output) -> Result {
    let listed: Vec<_> = objects
        .iter()
        .map(|object| Listed {
            index: object.first,
            count: object.count,
            name: object.name,
            chapter: object.chapter,
        })
        .collect();
    output.data(&listed, |out| {
        output::print(out, &listed, |row| {
            let family =
                if row.count > 1 { format!("@0..@{}", row.count - 1) } else { String::new() };
            [format!("0x{:04X}", row.index), row.name.to_owned(), family, row.chapter.to_owned()]
        })
    })
}

/// Lists the entries of one object, or the objects whose names contain `name`.
fn list(name: &str, names: bool, context: &Context) -> Result {
    let path: ObjectPath = match name.parse() {
        Ok(path) => path,
        Err(reason) => {
            let part = name.to_lowercase();
            let is_like = |object: &&&Object| object.name.to_lowercase().contains(&part);
            let found: Vec<_> = objects().iter().filter(is_like).copied().collect();
            return match found.is_empty() {
                true => Err(Failure::Usage(reason)),
                false => list_objects(&found, &context.output),
            };
        }
    };
    let Some(known) = object(path.index) else {
        return Err(Failure::Usage(format!(
            "0x{:04X} is not an object of the manual; see `ecan sdo list`; `ecan sdo read 0x{0:04X}:0 --type \
             TYPE` reads another one",
            path.index
        )));
    };
    // Without a colon, the whole object is listed.
    let only = name.contains(':').then_some(path.subindex);
    let is_listed = |entry: &&Entry| only.is_none_or(|subindex| subindex == entry.subindex);
    let entries: Vec<_> = known.entries.iter().filter(is_listed).collect();
    if let (Some(subindex), []) = (only, &entries[..]) {
        let text = format!("{} has no entry :{subindex:02} in the table", known.name);
        return Err(Failure::Usage(text));
    }
    if names {
        return list_entries(path.index, known, &entries, &context.output);
    }
    let bus = context.bus()?;
    let slave = bus.slave()?;
    let mut readings = Readings::default();
    let mut values = Vec::new();
    for entry in entries {
        let path = ObjectPath { index: path.index, subindex: entry.subindex };
        if !entry.access.can_read() {
            values.push(Read::missing(slave, path, None));
            continue;
        }
        let read = readings.note(read(&bus, slave, path));
        readings.answers()?;
        values.push(read.unwrap_or_else(|reason| Read::missing(slave, path, Some(reason))));
    }
    readings.any()?;
    context.output.data(&values, |out| {
        writeln!(out, "{}", heading(path.index, known))?;
        output::print(out, &values, |row| {
            let name = row.name.unwrap_or_default().to_owned();
            let value = match &row.error {
                Some(reason) => not_read(reason),
                None => row.text.clone().unwrap_or_else(|| WRITE_ONLY.to_owned()),
            };
            let meaning = row.meaning.clone().unwrap_or_default();
            [format!(":{:02}", row.subindex), name, value, meaning]
        })
    })?;
    readings.end()
}

fn heading(index: u16, object: &Object) -> String {
    format!("0x{index:04X} {} (manual {})", object.name, object.chapter)
}

#[derive(Debug, Serialize)]
struct ListedEntry {
    subindex: u8,
    name: &'static str,
    #[serde(rename = "type")]
    ty: &'static str,
    access: &'static str,
    unit: Option<&'static str>,
    values: Vec<(u32, &'static str)>,
    bits: Vec<(u8, &'static str)>,
}

fn list_entries(index: u16, object: &Object, entries: &[&Entry], output: &Output) -> Result {
    let listed = |entry: &&Entry| ListedEntry {
        subindex: entry.subindex,
        name: entry.name,
        ty: entry.ty.name(),
        access: access(entry),
        unit: entry.unit,
        values: entry.values.to_vec(),
        bits: entry.bits.to_vec(),
    };
    let entries: Vec<_> = entries.iter().map(listed).collect();
    output.data(&entries, |out| {
        writeln!(out, "{}", heading(index, object))?;
        output::print(out, &entries, |row| {
            let values = row.values.iter().map(|(number, word)| format!("{number} {word}"));
            let bits = row.bits.iter().map(|(bit, word)| format!("bit {bit} {word}"));
            let unit = row.unit.map(|unit| format!("in {unit}"));
            let words: Vec<_> = unit.into_iter().chain(values).chain(bits).collect();
            let (access, subindex) = (row.access.to_owned(), format!(":{:02}", row.subindex));
            [subindex, row.ty.to_owned(), access, row.name.to_owned(), words.join(", ")]
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn compare_written(index: u16, subindex: u8, written: u64, found: u64) -> (bool, String) {
        let path = ObjectPath { index, subindex };
        let entry = entry_of(path);
        let value = Value::Unsigned(found);
        let text = Some(value.text(entry));
        let read = Read { text, value: Some(value), ..Read::missing(0, path, None) };
        let written = Written { read, written: Value::Unsigned(written), status: None };
        let mut out = Vec::new();
        print_written(&written, entry, &mut out).unwrap();
        (written.is_changed(entry), String::from_utf8(out).unwrap())
    }

    #[test]
    fn setting_that_the_gateway_changes_is_reported() {
        let name = "0x8001:19 (MCAN Channel Config 0, Nominal bitrate)";
        let kept = format!("{name} = 250000 bit/s (0x3D090)\n");
        assert_eq!(compare_written(0x8001, 19, 250_000, 250_000), (false, kept));
        let (is_changed, text) = compare_written(0x8001, 19, 250_000, 500_000);
        assert!(is_changed);
        let expected =
            format!("{name}: 250000 bit/s (0x3D090) written\n{name} = 500000 bit/s (0x7A120)\n");
        assert_eq!(text, expected);
        // The gateway answers a request in its own time.
        assert!(!compare_written(0xB000, 1, 1, 0).0);
    }
}
