//! Signals of frames by DBC files.

use std::path::{Path, PathBuf};

use clap::Args;
use ecan_can_io::dbc::{Database, DbcFault, Decoded, DecodedSignal, Message, Number, UnknownName};
use ecan_protocol::can::CanFrame;
use ecan_protocol::text::Printable;
use serde::Serialize;

use crate::context::{Failure, Result, note};
use crate::frames::channels::parse_channel;

/// Faults of a file that are named.
const MOST_WARNINGS: usize = 10;

#[derive(Clone, Debug, Args)]
pub struct DbcOption {
    /// DBC file of signals: of all channels, or of one as 1=FILE; several are allowed
    #[arg(long, value_name = "FILE", value_parser = parse_file)]
    dbc: Vec<DbcFile>,
}

#[derive(Clone, Debug)]
struct DbcFile {
    channel: Option<u8>,
    path: PathBuf,
}

fn parse_file(text: &str) -> Result<DbcFile, String> {
    let of_channel = text.split_once('=').map(|(channel, path)| (parse_channel(channel), path));
    Ok(match of_channel {
        Some((Ok(channel), path)) => DbcFile { channel: Some(channel), path: path.into() },
        _ => DbcFile { channel: None, path: text.into() },
    })
}

impl DbcOption {
    /// Reads the files.
    pub fn read(&self) -> Result<Signals> {
        let read = |file: &DbcFile| {
            let failure =
                |what, error: &dyn ToString| Failure::file(what, &file.path, error.to_string());
            let bytes = std::fs::read(&file.path).map_err(|error| failure("read", &error))?;
            let database = Database::parse(&bytes).map_err(|error| failure("use", &error))?;
            report_warnings(&file.path, database.warnings());
            Ok((file.channel, database))
        };
        self.dbc.iter().map(read).collect::<Result<_>>().map(|files| Signals { files })
    }
}

/// Reports the first faults of a file, their number, and what they mean for its use.
fn report_warnings(path: &Path, warnings: &[DbcFault]) {
    let path = Printable(path.display());
    for fault in warnings.iter().take(MOST_WARNINGS) {
        note(format_args!("warning: {path}: {}", Printable(fault)));
    }
    if !warnings.is_empty() {
        let count = warnings.len();
        note(format_args!(
            "warning: {path}: messages and signals with faults are left out, of equal messages the last one counts; \
             faults: {count}"
        ));
    }
}

/// Messages of DBC files, by channel.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Signals {
    /// `None`: of all channels.
    files: Vec<(Option<u8>, Database)>,
}

impl Signals {
    pub fn is_empty(&self) -> bool {
        self.files.is_empty()
    }

    /// Files of a channel, those of this channel alone first.
    fn of_channel(&self, channel: u8) -> impl Iterator<Item = &Database> {
        let of = move |wanted| {
            let files = self.files.iter().filter(move |(it, _)| *it == wanted);
            files.map(|(_, database)| database)
        };
        of(Some(channel)).chain(of(None))
    }

    pub fn decode(&self, channel: u8, frame: &CanFrame) -> Option<Decoded<'_>> {
        self.of_channel(channel).find_map(|database| database.decode(frame))
    }

    /// Message of a channel by its name.
    pub fn message(&self, channel: u8, name: &str) -> Result<&Message, UnknownName> {
        let what = "message";
        let mut unknown = UnknownName { what, name: name.to_owned(), similar: Vec::new() };
        for database in self.of_channel(channel) {
            match database.message_named(name) {
                Ok(message) => return Ok(message),
                Err(error) => unknown.similar.extend(error.similar),
            }
        }
        Err(unknown)
    }
}

/// Lines of the message and its signals, below the line of the frame.
pub fn lines(decoded: &Decoded<'_>) -> impl Iterator<Item = String> {
    let name = |decoded: &DecodedSignal<'_>| Printable(&decoded.signal.name).to_string();
    let length = |decoded: &DecodedSignal<'_>| name(decoded).chars().count();
    let width = decoded.signals.iter().map(length).max().unwrap_or(0);
    let signal = move |decoded: &DecodedSignal<'_>| {
        format!("            {:width$}  {}", name(decoded), Printable(decoded.value_text()))
    };
    let head = format!("          {}{}", Printable(&decoded.message.name), missing(decoded));
    std::iter::once(head).chain(decoded.signals.iter().map(signal).collect::<Vec<_>>())
}

/// Remark on signals that the frame is too short for.
pub fn missing(decoded: &Decoded<'_>) -> String {
    match decoded.missing {
        0 => String::new(),
        count => format!(", frame too short, signals missing: {count}"),
    }
}

/// JSON form of the message of a frame.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct DecodedMessage {
    message: String,
    signals: Vec<SignalValue>,
    /// Signals that the frame is too short for.
    missing_signals: usize,
}

#[derive(Clone, Debug, PartialEq, Serialize)]
struct SignalValue {
    name: String,
    /// `null` for a float that is no number.
    value: serde_json::Value,
    unit: String,
    text: Option<String>,
}

impl From<Decoded<'_>> for DecodedMessage {
    fn from(decoded: Decoded<'_>) -> Self {
        let value = |decoded: &DecodedSignal<'_>| SignalValue {
            name: decoded.signal.name.clone(),
            value: json(decoded.value),
            unit: decoded.signal.unit.clone(),
            text: decoded.text.map(str::to_owned),
        };
        Self {
            message: decoded.message.name.clone(),
            signals: decoded.signals.iter().map(value).collect(),
            missing_signals: decoded.missing,
        }
    }
}

fn json(value: Number) -> serde_json::Value {
    let integer = match value {
        Number::Integer(value) => serde_json::Number::from_i128(value),
        // As shown: without the digits of the binary fraction.
        _ => None,
    };
    let real = || value.to_string().parse().ok().and_then(serde_json::Number::from_f64);
    integer.or_else(real).map_or(serde_json::Value::Null, serde_json::Value::Number)
}

#[cfg(test)]
impl Signals {
    /// Signals of a DBC file with this text, of all channels.
    pub fn of_text(text: &str) -> Self {
        Self { files: vec![(None, Database::parse(text.as_bytes()).unwrap())] }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_have_a_channel_or_none() {
        let parse = |text| parse_file(text).map(|option| (option.channel, option.path));
        assert_eq!(parse("cell.dbc"), Ok((None, "cell.dbc".into())));
        assert_eq!(parse("2=cell.dbc"), Ok((Some(2), "cell.dbc".into())));
        assert_eq!(parse("can1=a=b"), Ok((Some(1), "a=b".into())));
        assert_eq!(parse("a=b"), Ok((None, "a=b".into())));
    }

    #[test]
    fn numbers_in_json_have_the_shown_digits() {
        assert_eq!(json(Number::Integer(u64::MAX.into())).to_string(), "18446744073709551615");
        assert_eq!(json(Number::Integer(-(1 << 63))).to_string(), "-9223372036854775808");
        assert_eq!(json(Number::Decimal(0.1 * 3.0, 1)).to_string(), "0.3");
        assert_eq!(json(Number::Single(0.1)).to_string(), "0.1");
        assert_eq!(json(Number::Double(f64::NAN)).to_string(), "null");
        assert_eq!(json(Number::Double(1e300)).to_string(), "1e+300");
    }
}
