//! From the items of a file to messages.

use core::fmt;
use std::borrow::Cow;
use std::collections::{BTreeMap, HashMap};

use can_dbc::{
    AttributeDefinition, AttributeValueType, ExtendedMultiplex, MultiplexIndicator, NumericValue,
    SignalExtendedValueType, ValueDescription,
};
use can_dbc_pest::{DbcParser, Error as SyntaxError, Pair, Parser, Rule};
use ecan_protocol::can::CanId;
use pest::error::LineColLocation;
use thiserror::Error;

use super::signal::{BitLayout, ByteOrder, Condition, Message, Signal, SignalKind};

const EXTENDED_FLAG: u64 = 1 << 31;
/// Message of signals that are in no message.
const INDEPENDENT_SIGNALS: &str = "VECTOR__INDEPENDENT_SIG_MSG";
const MAX_BYTES: usize = 64;
const MAX_CLASSIC_BYTES: usize = 8;

pub fn read(bytes: &[u8]) -> Result<Vec<Message>, DbcFaults> {
    let text = text_of(bytes);
    let items = items(&text).map_err(|fault| DbcFaults(vec![fault]))?;
    let mut reader = Reader::default();
    for item in &items {
        match item.as_rule() {
            Rule::message => reader.message(item),
            Rule::attr_def | Rule::ba_def_def | Rule::attr_value => reader.attributes.take(item),
            _ => {}
        }
    }
    // These refer to messages, in any order.
    for item in &items {
        match item.as_rule() {
            Rule::value_table_def => reader.texts(item),
            Rule::signal_value_type => reader.value_type(item),
            Rule::sg_mul_val => reader.extended_multiplexing(item),
            _ => {}
        }
    }
    reader.finish()
}

/// A message and what its items state about multiplexing, by index of the signal.
#[derive(Debug)]
struct ReadMessage<'a> {
    message: Message,
    /// CAN ID as the file writes it.
    key: &'a str,
    lines: Vec<usize>,
    indicators: Vec<MultiplexIndicator>,
    extended: BTreeMap<usize, Condition>,
}

#[derive(Debug, Default)]
struct Reader<'a> {
    messages: Vec<ReadMessage<'a>>,
    by_key: HashMap<&'a str, usize>,
    attributes: Attributes<'a>,
    faults: Vec<DbcFault>,
}

impl<'a> Reader<'a> {
    fn fault(&mut self, line: usize, kind: FaultKind) {
        self.faults.push(DbcFault { line, kind });
    }

    fn message(&mut self, item: &Pair<'a, Rule>) {
        let line = line_of(item);
        let name = part_text(item, Rule::message_name);
        if name == INDEPENDENT_SIGNALS {
            return;
        }
        let key = part(item, Rule::msg_var).map_or("", |id| part_text(&id, Rule::message_id));
        let Some(id) = can_id(key) else {
            return self.fault(line, FaultKind::CanId(key.to_owned()));
        };
        let length = part_text(item, Rule::message_size);
        let Some(bytes) = length.parse().ok().filter(|length| *length <= MAX_BYTES) else {
            return self.fault(line, FaultKind::Length(length.to_owned()));
        };
        let first = self.messages.iter().map(|message| &message.message);
        let same =
            first.clone().find(|other| other.id == id).map(|message| ("CAN ID", key, message.line));
        let same = same.or_else(|| {
            first.clone().find(|other| other.name == name).map(|same| ("message", name, same.line))
        });
        if let Some((what, value, first)) = same {
            let duplicate = FaultKind::Duplicate { what, value: value.to_owned(), line: first };
            return self.fault(line, duplicate);
        }
        let mut read = ReadMessage {
            message: Message {
                id,
                name: name.to_owned(),
                length: bytes,
                is_fd: bytes > MAX_CLASSIC_BYTES,
                has_bit_rate_switch: true,
                line,
                signals: Vec::new(),
            },
            key,
            lines: Vec::new(),
            indicators: Vec::new(),
            extended: BTreeMap::new(),
        };
        for item in item.clone().into_inner().filter(|inner| inner.as_rule() == Rule::signal) {
            self.signal(&item, &mut read);
        }
        self.by_key.insert(key, self.messages.len());
        self.messages.push(read);
    }

    fn signal(&mut self, item: &Pair<'a, Rule>, read: &mut ReadMessage<'a>) {
        // The item begins with the line break before it.
        let line =
            part(item, Rule::signal_name).map_or_else(|| line_of(item), |name| line_of(&name));
        let raw = match can_dbc::Signal::try_from(item.clone()) {
            Ok(raw) => raw,
            Err(error) => return self.fault(line, FaultKind::Value(error.to_string())),
        };
        let same = read.message.signals.iter().position(|other| other.name == raw.name);
        if let Some(first) = same.and_then(|at| read.lines.get(at)) {
            let duplicate = FaultKind::Duplicate { what: "signal", value: raw.name, line: *first };
            return self.fault(line, duplicate);
        }
        let order = match raw.byte_order {
            can_dbc::ByteOrder::LittleEndian => ByteOrder::LittleEndian,
            can_dbc::ByteOrder::BigEndian => ByteOrder::BigEndian,
        };
        let bytes = read.message.length;
        let Some(layout) = BitLayout::new(raw.start_bit, raw.size, order, bytes) else {
            let (signal, start, bits) = (raw.name, raw.start_bit, raw.size);
            return self.fault(line, FaultKind::Bits { signal, start, bits, bytes });
        };
        let (least, most) = (number(raw.min), number(raw.max));
        read.lines.push(line);
        read.indicators.push(raw.multiplexer_indicator);
        read.message.signals.push(Signal {
            name: raw.name,
            unit: raw.unit.replace("\\\"", "\""),
            kind: match raw.value_type {
                can_dbc::ValueType::Signed => SignalKind::Signed,
                can_dbc::ValueType::Unsigned => SignalKind::Unsigned,
            },
            factor: raw.factor,
            offset: raw.offset,
            range: (least < most).then_some((least, most)),
            texts: Vec::new(),
            condition: None,
            initial: 0,
            layout,
        });
    }

    /// The message of an item that refers to one, and the signal.
    fn referred(&mut self, item: &Pair<'a, Rule>) -> Result<(usize, usize), String> {
        let key = part_text(item, Rule::message_id);
        let name = part_text(item, Rule::signal_name);
        let message = self.by_key.get(key).copied();
        let message = message.ok_or_else(|| format!("message {key}"))?;
        let signals = self.messages.get(message).map(|message| &message.message.signals);
        let signal =
            signals.and_then(|signals| signals.iter().position(|signal| signal.name == name));
        Ok((message, signal.ok_or_else(|| format!("signal {name} of message {key}"))?))
    }

    fn signal_mut(&mut self, (message, signal): (usize, usize)) -> Option<&mut Signal> {
        self.messages.get_mut(message)?.message.signals.get_mut(signal)
    }

    /// Texts of a signal. Those of a signal that does not exist are not used: editors leave them.
    fn texts(&mut self, item: &Pair<'a, Rule>) {
        let description = match ValueDescription::try_from(item.clone()) {
            Ok(description) => description,
            Err(error) => return self.fault(line_of(item), FaultKind::Value(error.to_string())),
        };
        let ValueDescription::Signal { value_descriptions, .. } = description else { return };
        let Ok(at) = self.referred(item) else { return };
        if let Some(signal) = self.signal_mut(at) {
            let texts = value_descriptions.into_iter();
            signal.texts =
                texts.map(|text| (text.id, text.description.replace("\\\"", "\""))).collect();
        }
    }

    fn value_type(&mut self, item: &Pair<'a, Rule>) {
        let line = line_of(item);
        let value_type = item.clone().into_inner().last().map(|inner| inner.as_rule());
        let kind = match value_type.map(SignalExtendedValueType::try_from) {
            Some(Ok(SignalExtendedValueType::IEEEfloat32Bit)) => SignalKind::Float32,
            Some(Ok(SignalExtendedValueType::IEEEdouble64bit)) => SignalKind::Float64,
            _ => return,
        };
        let at = match self.referred(item) {
            Ok(at) => at,
            Err(reference) => return self.fault(line, FaultKind::Reference(reference)),
        };
        let Some(signal) = self.signal_mut(at) else { return };
        let expected = if kind == SignalKind::Float32 { 32 } else { 64 };
        let bits = signal.layout.length();
        if bits != expected {
            let signal = signal.name.clone();
            return self.fault(line, FaultKind::FloatLength { signal, bits, expected });
        }
        signal.kind = kind;
    }

    fn extended_multiplexing(&mut self, item: &Pair<'a, Rule>) {
        let line = line_of(item);
        let multiplex = match ExtendedMultiplex::try_from(item.clone()) {
            Ok(multiplex) => multiplex,
            Err(error) => return self.fault(line, FaultKind::Value(error.to_string())),
        };
        let (message, signal) = match self.referred(item) {
            Ok(at) => at,
            Err(reference) => return self.fault(line, FaultKind::Reference(reference)),
        };
        let Some(read) = self.messages.get_mut(message) else { return };
        let name = multiplex.multiplexor_signal_name;
        let Some(multiplexer) = read.message.signals.iter().position(|other| other.name == name)
        else {
            let reference = format!("signal {name} of message {}", read.key);
            return self.fault(line, FaultKind::Reference(reference));
        };
        let values = multiplex
            .mappings
            .iter()
            .map(|multiplex| multiplex.min_value..=multiplex.max_value)
            .collect();
        read.extended.insert(signal, Condition { multiplexer, values });
    }

    fn finish(mut self) -> Result<Vec<Message>, DbcFaults> {
        for mut read in std::mem::take(&mut self.messages) {
            self.multiplex(&mut read);
            let key = read.key;
            let message = &mut read.message;
            message.is_fd |= self.attributes.is_fd(key).unwrap_or(false);
            message.has_bit_rate_switch = self.attributes.has_bit_rate_switch(key).unwrap_or(true);
            for signal in &mut message.signals {
                let start = self.attributes.start_value(key, &signal.name);
                signal.initial = start.map_or(0, |value| signal.raw_of(value));
            }
            self.messages.push(read);
        }
        if self.faults.is_empty() {
            return Ok(self.messages.into_iter().map(|read| read.message).collect());
        }
        self.faults.sort_by_key(|fault| fault.line);
        Err(DbcFaults(self.faults))
    }

    /// Sets the conditions of multiplexed signals.
    fn multiplex(&mut self, read: &mut ReadMessage<'_>) {
        let is_multiplexer =
            |indicator: &MultiplexIndicator| *indicator == MultiplexIndicator::Multiplexor;
        let count = read.indicators.iter().filter(|indicator| is_multiplexer(indicator)).count();
        let multiplexer = read.indicators.iter().position(is_multiplexer);
        for (at, indicator) in read.indicators.iter().enumerate() {
            let condition = match (read.extended.remove(&at), indicator) {
                (Some(condition), _) => condition,
                (
                    None,
                    MultiplexIndicator::MultiplexedSignal(value)
                    | MultiplexIndicator::MultiplexorAndMultiplexedSignal(value),
                ) => match multiplexer.filter(|_| count == 1) {
                    Some(multiplexer) => Condition { multiplexer, values: vec![*value..=*value] },
                    None => {
                        let name = read.message.signals.get(at).map(|signal| signal.name.clone());
                        let kind =
                            FaultKind::Multiplexer { signal: name.unwrap_or_default(), count };
                        self.fault(read.lines.get(at).copied().unwrap_or_default(), kind);
                        continue;
                    }
                },
                _ => continue,
            };
            if let Some(signal) = read.message.signals.get_mut(at) {
                signal.condition = Some(condition);
            }
        }
        let signals = &read.message.signals;
        let above =
            |at: usize| signals.get(at)?.condition.as_ref().map(|condition| condition.multiplexer);
        for (at, signal) in signals.iter().enumerate() {
            // A chain without a cycle has at most as many links as signals.
            let chain = std::iter::successors(above(at), |signal| above(*signal));
            if chain.take(signals.len()).count() == signals.len() {
                let line = read.lines.get(at).copied().unwrap_or_default();
                self.fault(line, FaultKind::MultiplexerCycle(signal.name.clone()));
                break;
            }
        }
    }
}

fn can_id(key: &str) -> Option<CanId> {
    let raw: u64 = key.parse().ok()?;
    let is_extended = raw & EXTENDED_FLAG != 0;
    CanId::new(u32::try_from(raw & !EXTENDED_FLAG).ok()?, is_extended).ok()
}

fn number(value: NumericValue) -> f64 {
    match value {
        NumericValue::Uint(value) => value as f64,
        NumericValue::Int(value) => value as f64,
        NumericValue::Double(value) => value,
    }
}

/// Longest text of a line in a message.
const MAX_QUOTED: usize = 80;

/// Text in UTF-8, or else in Windows-1252, which programs of Windows write.
pub fn text_of(bytes: &[u8]) -> Cow<'_, str> {
    match std::str::from_utf8(bytes) {
        Ok(text) => Cow::Borrowed(text.strip_prefix('\u{FEFF}').unwrap_or(text)),
        Err(_) => can_dbc::decode_cp1252(bytes).unwrap_or(String::from_utf8_lossy(bytes)),
    }
}

/// Items of the file.
pub fn items(text: &str) -> Result<Vec<Pair<'_, Rule>>, DbcFault> {
    let file = DbcParser::parse(Rule::file, text).map_err(|error| fault(text, &error))?;
    // The only pair at this level is the file.
    Ok(file.flat_map(Pair::into_inner).collect())
}

fn fault(text: &str, error: &SyntaxError<Rule>) -> DbcFault {
    let (LineColLocation::Pos((line, column)) | LineColLocation::Span((line, column), _)) =
        error.line_col;
    let content = text.lines().nth(line.saturating_sub(1)).unwrap_or_default();
    // No control sequence of the file reaches a terminal.
    let printable = |character: char| {
        if character.is_control() { char::REPLACEMENT_CHARACTER } else { character }
    };
    let text = content.trim().chars().take(MAX_QUOTED).map(printable).collect();
    DbcFault { line, kind: FaultKind::Syntax { column, text } }
}

/// Line of an item, from 1.
pub fn line_of(item: &Pair<'_, Rule>) -> usize {
    item.line_col().0
}

/// First part of an item with this rule.
pub fn part<'a>(item: &Pair<'a, Rule>, rule: Rule) -> Option<Pair<'a, Rule>> {
    item.clone().into_inner().find(|part| part.as_rule() == rule)
}

/// Text of a part; empty if there is none.
pub fn part_text<'a>(item: &Pair<'a, Rule>, rule: Rule) -> &'a str {
    part(item, rule).map_or("", |part| part.as_str())
}

/// Text without its quotes.
pub fn unquoted(text: &str) -> &str {
    text.strip_prefix('"').and_then(|rest| rest.strip_suffix('"')).unwrap_or(text)
}

const FRAME_FORMAT: &str = "VFrameFormat";
const BIT_RATE_SWITCH: &str = "CANFD_BRS";
const START_VALUE: &str = "GenSigStartValue";

/// Values of attributes by message, or by message and signal, as texts.
#[derive(Debug, Default)]
pub struct Attributes<'a> {
    /// Values of attributes of kind ENUM.
    values: HashMap<String, Vec<String>>,
    defaults: HashMap<&'a str, &'a str>,
    messages: HashMap<(&'a str, &'a str), &'a str>,
    signals: HashMap<(&'a str, &'a str, &'a str), &'a str>,
}

impl<'a> Attributes<'a> {
    /// Takes an item that defines or sets an attribute.
    pub fn take(&mut self, item: &Pair<'a, Rule>) {
        let name = unquoted(part_text(item, Rule::attribute_name));
        match item.as_rule() {
            Rule::attr_def => {
                let definition = AttributeDefinition::try_from(item.clone());
                let Ok(AttributeDefinition::Message(name, AttributeValueType::Enum(values))) =
                    definition
                else {
                    return;
                };
                self.values.insert(name, values);
            }
            Rule::ba_def_def => {
                self.defaults.insert(name, value_of(item));
            }
            Rule::attr_value => {
                if let Some(object) = part(item, Rule::msg_var_val) {
                    let message = part_text(&object, Rule::message_id);
                    self.messages.insert((name, message), value_of(&object));
                } else if let Some(object) = part(item, Rule::signal_var) {
                    let message = part_text(&object, Rule::message_id);
                    let signal = part_text(&object, Rule::ident);
                    self.signals.insert((name, message, signal), value_of(&object));
                }
            }
            _ => {}
        }
    }

    /// Returns whether the frame format of a message is CAN FD; `None` if the file does not state it.
    pub fn is_fd(&self, message: &str) -> Option<bool> {
        self.message_text(FRAME_FORMAT, message).map(|format| format.ends_with("_FD"))
    }

    pub fn has_bit_rate_switch(&self, message: &str) -> Option<bool> {
        self.message_text(BIT_RATE_SWITCH, message).map(|value| value != "0")
    }

    /// Start value of a signal, as a raw value.
    pub fn start_value(&self, message: &str, signal: &str) -> Option<&'a str> {
        let value = self.signals.get(&(START_VALUE, message, signal));
        value.or_else(|| self.defaults.get(START_VALUE)).copied()
    }

    /// An attribute of kind ENUM has the text of its index or the text itself.
    fn message_text(&self, name: &str, message: &str) -> Option<&str> {
        let value = self.messages.get(&(name, message)).or_else(|| self.defaults.get(name))?;
        let values = self.values.get(name)?;
        let index =
            value.parse::<usize>().ok().filter(|_| !values.iter().any(|known| known == value));
        Some(index.and_then(|at| values.get(at)).map_or(value, String::as_str))
    }
}

/// The value of an attribute, the last part.
fn value_of<'a>(item: &Pair<'a, Rule>) -> &'a str {
    let value = item
        .clone()
        .into_inner()
        .filter(|part| matches!(part.as_rule(), Rule::number | Rule::quoted_str))
        .last();
    value.map_or("", |part| unquoted(part.as_str()))
}

/// Fault in a line.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[error("line {line}: {kind}")]
pub struct DbcFault {
    /// Line, from 1.
    pub line: usize,
    /// Kind of fault.
    pub kind: FaultKind,
}

/// Kind of fault.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum FaultKind {
    /// The line is not in the grammar.
    #[error("column {column}: syntax error in \"{text}\"")]
    Syntax {
        /// Column, from 1.
        column: usize,
        /// Text of the line.
        text: String,
    },
    /// A value that the grammar allows and the format does not.
    #[error("{0}")]
    Value(String),
    /// CAN ID of a message.
    #[error(
        "CAN ID {0} is out of range; allowed: 0 to 2047, or 2147483648 plus an extended CAN ID of 0 \
         to 536870911"
    )]
    CanId(String),
    /// Length of a message.
    #[error("message length {0} is out of range; allowed: 0 to 64 bytes")]
    Length(String),
    /// CAN ID or name of another message.
    #[error("{what} {value} is also in line {line}")]
    Duplicate {
        /// Kind of the name.
        what: &'static str,
        /// CAN ID or name.
        value: String,
        /// Line of the first one.
        line: usize,
    },
    /// Bits of a signal.
    #[error(
        "signal {signal}: {bits} bits from bit {start} are not in {bytes} bytes; allowed: 1 to 64 bits"
    )]
    Bits {
        /// Name of the signal.
        signal: String,
        /// Start bit.
        start: u64,
        /// Length in bits.
        bits: u64,
        /// Length of the message in bytes.
        bytes: usize,
    },
    /// A float of another length.
    #[error("signal {signal}: a {expected} bit float has {bits} bits")]
    FloatLength {
        /// Name of the signal.
        signal: String,
        /// Length in bits.
        bits: u32,
        /// Length of the type.
        expected: u32,
    },
    /// A reference to a message or signal that does not exist.
    #[error("{0} does not exist")]
    Reference(String),
    /// A multiplexed signal in a message without multiplexer or with several.
    #[error(
        "signal {signal} is multiplexed, but the message has {count} multiplexers; expected 1, or SG_MUL_VAL_"
    )]
    Multiplexer {
        /// Name of the signal.
        signal: String,
        /// Number of multiplexers.
        count: usize,
    },
    /// A multiplexer that depends on itself.
    #[error("signal {0} is multiplexed by itself")]
    MultiplexerCycle(String),
}

/// Faults of a file, in the order of their lines.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub struct DbcFaults(pub Vec<DbcFault>);

impl fmt::Display for DbcFaults {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0.as_slice() {
            [only] => write!(f, "{only}"),
            all => {
                write!(f, "{} faults", all.len())?;
                all.iter().try_for_each(|fault| write!(f, "\n  - {fault}"))
            }
        }
    }
}
