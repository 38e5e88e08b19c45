//! From the items of a file to messages.

use std::collections::{BTreeMap, HashMap};

use can_dbc::{
    ExtendedMultiplex, MultiplexIndicator, NumericValue, SignalExtendedValueType, ValueDescription,
};
use can_dbc_pest::{Pair, Rule};
use ecan_protocol::can::CanId;

use crate::dbc::attributes::Attributes;
use crate::dbc::bit_layout::{BitLayout, ByteOrder};
use crate::dbc::fault::{DbcFault, DbcFaults, FaultKind};
use crate::dbc::message::Message;
use crate::dbc::signal::{Condition, Signal, SignalKind};
use crate::dbc::syntax::{items, line_of, part, part_text, text_of};

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
        let key = part(item, Rule::msg_var).map_or("", |it| part_text(&it, Rule::message_id));
        let Some(id) = can_id(key) else {
            return self.fault(line, FaultKind::CanId(key.to_owned()));
        };
        let length = part_text(item, Rule::message_size);
        let Some(bytes) = length.parse().ok().filter(|length| *length <= MAX_BYTES) else {
            return self.fault(line, FaultKind::Length(length.to_owned()));
        };
        let first = self.messages.iter().map(|it| &it.message);
        let same = first.clone().find(|it| it.id == id).map(|it| ("CAN ID", key, it.line));
        let same = same.or_else(|| {
            first.clone().find(|it| it.name == name).map(|it| ("message", name, it.line))
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
        for item in item.clone().into_inner().filter(|it| it.as_rule() == Rule::signal) {
            self.signal(&item, &mut read);
        }
        self.by_key.insert(key, self.messages.len());
        self.messages.push(read);
    }

    fn signal(&mut self, item: &Pair<'a, Rule>, read: &mut ReadMessage<'a>) {
        // The item begins with the line break before it.
        let line = part(item, Rule::signal_name).map_or_else(|| line_of(item), |it| line_of(&it));
        let raw = match can_dbc::Signal::try_from(item.clone()) {
            Ok(raw) => raw,
            Err(error) => return self.fault(line, FaultKind::Value(error.to_string())),
        };
        let same = read.message.signals.iter().position(|it| it.name == raw.name);
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
        let signals = self.messages.get(message).map(|it| &it.message.signals);
        let signal = signals.and_then(|it| it.iter().position(|it| it.name == name));
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
            signal.texts = texts.map(|it| (it.id, it.description.replace("\\\"", "\""))).collect();
        }
    }

    fn value_type(&mut self, item: &Pair<'a, Rule>) {
        let line = line_of(item);
        let value_type = item.clone().into_inner().last().map(|it| it.as_rule());
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
        let Some(multiplexer) = read.message.signals.iter().position(|it| it.name == name) else {
            let reference = format!("signal {name} of message {}", read.key);
            return self.fault(line, FaultKind::Reference(reference));
        };
        let values = multiplex.mappings.iter().map(|it| it.min_value..=it.max_value).collect();
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
            return Ok(self.messages.into_iter().map(|it| it.message).collect());
        }
        self.faults.sort_by_key(|it| it.line);
        Err(DbcFaults(self.faults))
    }

    /// Sets the conditions of multiplexed signals.
    fn multiplex(&mut self, read: &mut ReadMessage<'_>) {
        let is_multiplexer = |it: &MultiplexIndicator| *it == MultiplexIndicator::Multiplexor;
        let count = read.indicators.iter().filter(|it| is_multiplexer(it)).count();
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
                        let name = read.message.signals.get(at).map(|it| it.name.clone());
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
        let above = |at: usize| signals.get(at)?.condition.as_ref().map(|it| it.multiplexer);
        for (at, signal) in signals.iter().enumerate() {
            // A chain without a cycle has at most as many links as signals.
            let chain = std::iter::successors(above(at), |it| above(*it));
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
