//! `ecan node sdo`: objects of a node.

use std::io::{self, Write};
use std::time::Duration;

use clap::builder::{PossibleValuesParser, TypedValueParser};
use clap::{Args, Subcommand};
use ecan_canopen::{DataType, ObjectEntry, SdoFault};
use ecan_tool_support::command_line::options::milliseconds;
use serde::Serialize;

use super::node_client::{NodeClient, start_for};
use super::node_target::{JsonTarget, NodeTarget, SelectedNode, TargetArguments};
use super::object_value::{ObjectValue, moves_a_motor};
use super::objects::{DeviceFileArguments, ObjectKey, ObjectNames, number};
use crate::context::{Context, Failure, Output, Result};
use crate::frames::FrameOptions;
use crate::output;
use crate::output::confirm;

#[derive(Debug, Args)]
#[command(after_help = "\
An object is INDEX[:SUBINDEX], or OBJECT[/ENTRY] with (parts of) its names: those of the device file
(--eds), else of CiA 301 and CiA 402-2.
  ecan node sdo read --node 5 0x1018:1
  ecan node sdo read --node 5 'position actual value'
  ecan node sdo write --node 5 'producer heartbeat time' 500
  ecan node sdo list --node 5 identity
  ecan node sdo list --node 5 --eds drive.eds")]
pub struct SdoArguments {
    #[command(subcommand)]
    action: Action,
}

#[derive(Debug, Args)]
struct Common {
    #[command(flatten)]
    target: TargetArguments,
    #[command(flatten)]
    eds: DeviceFileArguments,
    /// Type of the value [default: by the device file or the standards; unsigned by its length]
    #[arg(long = "type", value_name = "TYPE", value_parser = type_parser())]
    ty: Option<DataType>,
    /// Time for an answer of the node
    #[arg(long, value_name = "TIME", default_value = "500ms", value_parser = milliseconds::<u64>(1..=600_000))]
    timeout: u64,
    #[command(flatten)]
    options: FrameOptions,
}

#[derive(Debug, Subcommand)]
enum Action {
    /// Read an object
    Read {
        /// Object
        object: String,
        #[command(flatten)]
        common: Common,
    },
    /// Write an object, and read it again if possible
    Write {
        /// Object
        object: String,
        /// Value; numbers also hexadecimal (0x) or octal (leading 0), bytes as hexadecimal pairs
        #[arg(allow_hyphen_values = true)]
        value: String,
        /// Write objects that can move a motor without asking
        #[arg(long)]
        yes: bool,
        #[command(flatten)]
        common: Common,
    },
    /// List the objects of the node with their values
    List {
        /// Object, or part of its name [default: all]
        object: Option<String>,
        /// List names only, without reading values
        #[arg(long)]
        names: bool,
        #[command(flatten)]
        common: Common,
    },
}

const TYPES: [(&str, DataType); 14] = [
    ("bool", DataType::Boolean),
    ("u8", DataType::Unsigned8),
    ("u16", DataType::Unsigned16),
    ("u32", DataType::Unsigned32),
    ("u64", DataType::Unsigned64),
    ("i8", DataType::Integer8),
    ("i16", DataType::Integer16),
    ("i32", DataType::Integer32),
    ("i64", DataType::Integer64),
    ("f32", DataType::Real32),
    ("f64", DataType::Real64),
    ("string", DataType::VisibleString),
    ("unicode", DataType::UnicodeString),
    ("bytes", DataType::Domain),
];

fn type_parser() -> impl TypedValueParser<Value = DataType> {
    PossibleValuesParser::new(TYPES.map(|(name, _)| name)).map(|name| {
        TYPES.iter().find(|known| known.0 == name).map_or(DataType::Domain, |known| known.1)
    })
}

/// Name of a type as in `--type`, else that of CiA 301.
fn type_name(data_type: DataType) -> String {
    let named = TYPES.iter().find(|known| known.1 == data_type);
    named.map_or_else(|| data_type.to_string(), |known| known.0.to_owned())
}

#[derive(Debug, Serialize)]
struct Read {
    #[serde(flatten)]
    node: JsonTarget,
    index: u16,
    subindex: u8,
    name: Option<String>,
    #[serde(rename = "type")]
    ty: Option<String>,
    access: Option<&'static str>,
    bytes: Option<Vec<u8>>,
    value: Option<serde_json::Value>,
    text: Option<String>,
    meaning: Option<String>,
    error: Option<String>,
}

pub fn run(arguments: &SdoArguments, context: &Context) -> Result {
    let common = match &arguments.action {
        Action::Read { common, .. }
        | Action::Write { common, .. }
        | Action::List { common, .. } => common,
    };
    let context = &context.on_stderr(common.options.capture.is_on_output());
    let selected = common.target.select(&common.options, context)?;
    let names = ObjectNames::of(&common.eds, &selected)?;
    let sdo = Sdo { common, target: selected.target, selected, names, context };
    match &arguments.action {
        Action::Read { object, .. } => sdo.read(object),
        Action::Write { object, value, yes, .. } => sdo.write(object, value, *yes),
        Action::List { object, names, .. } => sdo.list(object.as_deref(), *names),
    }
}

struct Sdo<'a> {
    common: &'a Common,
    target: NodeTarget,
    selected: SelectedNode,
    names: ObjectNames,
    context: &'a Context<'a>,
}

impl Sdo<'_> {
    fn start(&self) -> Result<NodeClient> {
        let link = start_for(&self.selected, true, self.context)?;
        Ok(NodeClient::new(link, self.target, Duration::from_millis(self.common.timeout)))
    }

    /// Type of an object: by `--type`, else by its name.
    fn type_of(&self, key: ObjectKey) -> Option<DataType> {
        self.common.ty.or_else(|| self.names.entry(key).map(|entry| entry.data_type))
    }

    fn data(&self, node: JsonTarget, key: ObjectKey, answer: Result<Vec<u8>, String>) -> Read {
        let entry = self.names.entry(key);
        let value =
            answer.as_ref().ok().map(|answer| ObjectValue::new(answer.clone(), self.type_of(key)));
        Read {
            node,
            index: key.0,
            subindex: key.1,
            name: entry.map(|_| self.names.name(key)),
            ty: self.type_of(key).map(type_name),
            access: entry.and_then(|entry| self.names.access(entry)).map(|entry| entry.word()),
            text: value.as_ref().map(ObjectValue::text),
            meaning: value.as_ref().and_then(|value| value.meaning(key)),
            value: value.as_ref().map(ObjectValue::json),
            bytes: value.map(|value| value.bytes),
            error: answer.err(),
        }
    }

    fn read(&self, object: &str) -> Result {
        let (index, subindex) = self.names.find(object).map_err(Failure::Usage)?;
        let read = self.start()?.run(|client| {
            let data = client.upload(index, subindex)?;
            Ok(self.data(client.json(), (index, subindex), Ok(data)))
        })?;
        self.context.output.data(&read, |out| print_value(&read, out))
    }

    fn write(&self, object: &str, text: &str, is_granted: bool) -> Result {
        let key = self.names.find(object).map_err(Failure::Usage)?;
        let (index, subindex) = key;
        let name = self.names.name(key);
        let Some(data_type) = self.type_of(key) else {
            let object = number(key);
            return Err(Failure::Usage(format!(
                "the type of {object} is not known; set it with --type, or use a device file (--eds)"
            )));
        };
        let entry = self.names.entry(key);
        let access = entry.and_then(|entry| self.names.access(entry));
        if let Some(access) = access.filter(|access| !access.is_writable()) {
            let object = number(key);
            return Err(Failure::Usage(format!(
                "{object} {name} cannot be written: its access is {access} by the device file"
            )));
        }
        let data = data_type.parse(text).and_then(|value| data_type.encode(&value));
        let data = data.map_err(|error| Failure::Usage(error.to_string()))?;
        let target = self.target;
        confirm(
            is_granted || !moves_a_motor(index),
            &format!("writing {} {name}", number(key)),
            format_args!("Write {text} to {name} of {target}: a motor can move. Continue?"),
            "the object was not written",
        )?;
        let (node, answer) = self.start()?.run(|client| {
            client.download(index, subindex, &data)?;
            Ok((client.json(), client.try_upload(index, subindex)?))
        })?;
        let is_other = answer.as_ref().is_ok_and(|answer| *answer != data);
        // An object that can only be written is not an error.
        let read = self.data(node, key, Ok(answer.unwrap_or(data)));
        self.context.output.data(&read, |out| print_value(&read, out))?;
        match is_other && !is_command(key) {
            true => Err(Failure::Rejected(format!(
                "{} of {target} has another value after the write; the node limits or ignores it",
                number(key)
            ))),
            false => Ok(()),
        }
    }

    fn list(&self, object: Option<&str>, is_names_only: bool) -> Result {
        let is_selected = self.selection(object)?;
        let entries: Vec<_> =
            self.names.entries().filter(|entry| is_selected.contains(&entry.index)).collect();
        let rows: Vec<_> = if is_names_only {
            let (channel, node) = (self.target.channel, self.target.node.get());
            let address = JsonTarget { slave: 0, channel, node };
            let row = |entry: &&ObjectEntry| Read {
                error: None,
                ..self.data(address, (entry.index, entry.subindex), Err(String::new()))
            };
            entries.iter().map(row).collect()
        } else {
            self.start()?.run(|client| self.read_all(client, &entries))?
        };
        self.context.output.data(&rows, |out| print_list(&rows, &self.context.output, out))
    }

    /// Reads the entries that the node has.
    fn read_all(&self, client: &mut NodeClient, entries: &[&ObjectEntry]) -> Result<Vec<Read>> {
        let mut rows = Vec::new();
        for entry in entries {
            let key = (entry.index, entry.subindex);
            let access = self.names.access(entry);
            if access.is_some_and(|access| !access.is_readable()) {
                rows.push(self.data(client.json(), key, Err("not readable".to_owned())));
                continue;
            }
            match client.try_upload(entry.index, entry.subindex)? {
                Ok(data) => rows.push(self.data(client.json(), key, Ok(data))),
                // Without a device file the node is asked for objects that it need not have.
                Err(SdoFault::Aborted(_)) if access.is_none() => {}
                Err(fault @ SdoFault::Aborted(_)) => {
                    rows.push(self.data(client.json(), key, Err(fault.to_string())));
                }
                Err(_) => {
                    // Returns the failure with its remedy.
                    client.upload(entry.index, entry.subindex)?;
                }
            }
        }
        Ok(rows)
    }

    /// Indices of the object, or of those whose names contain the text.
    fn selection(&self, object: Option<&str>) -> Result<Vec<u16>> {
        let Some(text) = object else {
            return Ok(self.names.entries().map(|entry| entry.index).collect());
        };
        if let Some(index) =
            crate::value::parse_unsigned(text).and_then(|number| u16::try_from(number).ok())
        {
            return Ok(vec![index]);
        }
        match self.names.objects_of(text) {
            found if found.is_empty() => Err(Failure::Usage(format!("unknown object \"{text}\""))),
            found => Ok(found),
        }
    }
}

/// Objects whose value may differ from the last write: store, restore, history, programs, and those that
/// can move a motor.
fn is_command((index, _): ObjectKey) -> bool {
    use ecan_canopen::object::{ERROR_HISTORY, RESTORE_PARAMETERS, STORE_PARAMETERS};
    matches!(index, STORE_PARAMETERS | RESTORE_PARAMETERS | ERROR_HISTORY)
        || (0x1F00..0x2000).contains(&index)
        || moves_a_motor(index)
}

fn print_value(read: &Read, out: &mut dyn Write) -> io::Result<()> {
    let name = read.name.as_ref().map_or_else(String::new, |name| format!(" {name}"));
    let meaning = read.meaning.as_ref().map_or_else(String::new, |meaning| format!(": {meaning}"));
    let text = read.text.as_deref().unwrap_or_default();
    writeln!(out, "{}{name} = {text}{meaning}", number((read.index, read.subindex)))
}

fn print_list(rows: &[Read], output: &Output, out: &mut dyn Write) -> io::Result<()> {
    output::print_with_titles(out, ["OBJECT", "TYPE", "ACCESS", "NAME", "VALUE"], rows, |read| {
        let value = match (&read.text, &read.error) {
            (Some(text), _) => {
                let meaning = read
                    .meaning
                    .as_ref()
                    .map_or_else(String::new, |meaning| format!(": {meaning}"));
                format!("{text}{meaning}")
            }
            (None, Some(error)) => output.toned(crate::context::Tone::Faint, error),
            (None, None) => String::new(),
        };
        [
            number((read.index, read.subindex)),
            read.ty.clone().unwrap_or_default(),
            read.access.unwrap_or("-").to_owned(),
            read.name.clone().unwrap_or_default(),
            value,
        ]
    })
}
