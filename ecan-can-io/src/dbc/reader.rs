//! From the statements of a file to messages.

use std::borrow::Cow;
use std::collections::{BTreeMap, HashMap};

use ecan_protocol::can::CanId;

use super::faults::{DbcFault, FaultKind};
use super::signal::{BitLayout, Condition, Message, Signal, SignalKind};
use super::syntax::{self, Item, Multiplexing};

const EXTENDED_FLAG: u64 = 1 << 31;
/// Message of signals that are in no message.
const INDEPENDENT_SIGNALS: &str = "VECTOR__INDEPENDENT_SIG_MSG";
const MAX_BYTES: usize = 64;
const MAX_CLASSIC_BYTES: usize = 8;

const FRAME_FORMAT: &str = "VFrameFormat";
const BIT_RATE_SWITCH: &str = "CANFD_BRS";
const START_VALUE: &str = "GenSigStartValue";
/// Names of more than 32 characters, which the statements have cut.
const LONG_MESSAGE: &str = "SystemMessageLongSymbol";
const LONG_SIGNAL: &str = "SystemSignalLongSymbol";

/// Text in UTF-8, or else in Windows-1252, which programs of Windows write.
pub fn text_of(bytes: &[u8]) -> Cow<'_, str> {
    match std::str::from_utf8(bytes) {
        Ok(text) => Cow::Borrowed(text.strip_prefix('\u{FEFF}').unwrap_or(text)),
        Err(_) => encoding_rs::WINDOWS_1252.decode_without_bom_handling(bytes).0,
    }
}

/// Messages of a file, and the faults of what is left out, in the order of their lines.
pub fn read(text: &str) -> (Vec<Message>, Vec<DbcFault>) {
    let mut reader = Reader::default();
    // Statements that refer to messages may come before them.
    let mut later = Vec::new();
    syntax::read(text, |line, item| match item {
        Ok(item) => match reader.take(line, item) {
            Ok(None) => {}
            Ok(Some(item)) => later.push((line, item)),
            Err(kind) => reader.faults.push(DbcFault { line, kind }),
        },
        Err(kind) => reader.faults.push(DbcFault { line, kind }),
    });
    for (line, item) in later {
        if let Err(kind) = reader.refer(item) {
            reader.faults.push(DbcFault { line, kind });
        }
    }
    reader.finish()
}

/// A message and what its statements say about multiplexing, by index of the signal.
#[derive(Debug)]
struct ReadMessage<'a> {
    message: Message,
    /// CAN ID as the file writes it.
    key: &'a str,
    lines: Vec<usize>,
    multiplexing: Vec<Multiplexing>,
    extended: BTreeMap<usize, Condition>,
}

#[derive(Debug, Default)]
struct Reader<'a> {
    messages: Vec<ReadMessage<'a>>,
    by_key: HashMap<&'a str, usize>,
    attributes: Attributes<'a>,
    faults: Vec<DbcFault>,
    /// True if the last line of a message could be read, so that the signals that follow belong to that message; `None`
    /// before the first such line.
    is_in_message: Option<bool>,
}

impl<'a> Reader<'a> {
    /// Takes a statement, unless it refers to messages.
    fn take(&mut self, line: usize, item: Item<'a>) -> Result<Option<Item<'a>>, FaultKind> {
        match item {
            Item::Message { id, name, length } => {
                self.is_in_message = Some(false);
                if name != INDEPENDENT_SIGNALS {
                    self.message(line, id, name, length)?;
                }
            }
            Item::Signal { name, .. } if self.is_in_message.is_none() => {
                return Err(FaultKind::Reference(format!("the message of signal {name}")));
            }
            // The fault of a message that is left out is reported already.
            Item::Signal { .. } if self.is_in_message == Some(false) => {}
            item @ Item::Signal { .. } => self.signal(line, item)?,
            Item::Values { .. } | Item::Default { .. } | Item::Attribute { .. } => {
                self.attributes.take(item);
            }
            Item::Texts { .. } | Item::ValueType { .. } | Item::Multiplexer { .. } => {
                return Ok(Some(item));
            }
            Item::NoMessage => self.is_in_message = Some(false),
            Item::Other => {}
        }
        Ok(None)
    }

    fn message(
        &mut self,
        line: usize,
        key: &'a str,
        name: &str,
        length: &str,
    ) -> Result<(), FaultKind> {
        let id = can_id(key).ok_or_else(|| FaultKind::CanId(key.to_owned()))?;
        let bytes = length.parse().ok().filter(|length| *length <= MAX_BYTES);
        let bytes = bytes.ok_or_else(|| FaultKind::Length(length.to_owned()))?;
        let messages = || self.messages.iter().map(|message| &message.message);
        let same = messages().find(|other| other.id == id).map(|same| ("CAN ID", key, same.line));
        let same = same.or_else(|| {
            messages().find(|other| other.name == name).map(|same| ("message", name, same.line))
        });
        self.by_key.insert(key, self.messages.len());
        self.is_in_message = Some(true);
        self.messages.push(ReadMessage {
            message: Message {
                id,
                name: name.to_owned(),
                short_name: None,
                length: bytes,
                is_fd: bytes > MAX_CLASSIC_BYTES,
                has_bit_rate_switch: true,
                line,
                signals: Vec::new(),
            },
            key,
            lines: Vec::new(),
            multiplexing: Vec::new(),
            extended: BTreeMap::new(),
        });
        match same {
            // The last one counts, as in cantools.
            Some((what, value, line)) => {
                Err(FaultKind::Duplicate { what, value: value.to_owned(), line })
            }
            None => Ok(()),
        }
    }

    fn signal(&mut self, line: usize, item: Item<'a>) -> Result<(), FaultKind> {
        let Item::Signal { name, multiplexing, start, bits, order, is_signed, .. } = item else {
            return Ok(());
        };
        let Item::Signal { factor, offset, range: (least, most), unit, .. } = item else {
            return Ok(());
        };
        let Some(read) = self.messages.last_mut() else { return Ok(()) };
        let same = read.message.signals.iter().position(|other| other.name == name);
        if let Some(first) = same.and_then(|at| read.lines.get(at)) {
            let (what, value) = ("signal", name.to_owned());
            return Err(FaultKind::Duplicate { what, value, line: *first });
        }
        let bytes = read.message.length;
        let layout = start.parse().ok().zip(bits.parse().ok());
        let layout = layout.and_then(|(start, bits)| BitLayout::new(start, bits, order, bytes));
        let layout = layout.ok_or_else(|| FaultKind::Bits {
            signal: name.to_owned(),
            start: start.to_owned(),
            bits: bits.to_owned(),
            bytes,
        })?;
        read.lines.push(line);
        read.multiplexing.push(multiplexing);
        read.message.signals.push(Signal {
            name: name.to_owned(),
            short_name: None,
            unit: unit.into_owned(),
            kind: if is_signed { SignalKind::Signed } else { SignalKind::Unsigned },
            factor,
            offset,
            range: (least < most).then_some((least, most)),
            texts: Vec::new(),
            condition: None,
            initial: 0,
            layout,
        });
        Ok(())
    }

    /// Takes a statement that refers to a signal.
    fn refer(&mut self, item: Item<'a>) -> Result<(), FaultKind> {
        match item {
            Item::Texts { message, signal, texts } => {
                // Editors leave those of signals that do not exist any more.
                let Ok(signal) = self.signal_of(message, signal) else { return Ok(()) };
                let whole = |value: &str| value.parse().ok();
                let wrong = texts.iter().find(|(value, _)| whole(value).is_none());
                let fault = wrong.map(|(value, _)| FaultKind::Value {
                    what: format!("value of signal {}", signal.name),
                    value: (*value).to_owned(),
                    allowed: "whole numbers of 64 bits",
                });
                let texts = texts.into_iter();
                let texts =
                    texts.filter_map(|(value, text)| Some((whole(value)?, text.into_owned())));
                signal.texts = texts.collect();
                return fault.map_or(Ok(()), Err);
            }
            Item::ValueType { message, signal, kind } => {
                let (kind, expected) = match kind {
                    "1" => (SignalKind::Float32, 32),
                    "2" => (SignalKind::Float64, 64),
                    _ => return Ok(()),
                };
                let signal = self.signal_of(message, signal)?;
                let bits = signal.layout.length();
                if bits != expected {
                    let signal = signal.name.clone();
                    return Err(FaultKind::FloatLength { signal, bits, expected });
                }
                signal.kind = kind;
            }
            Item::Multiplexer { message, signal, multiplexer, values } => {
                let (at, signal) = self.place_of(message, signal)?;
                let (_, multiplexer) = self.place_of(message, multiplexer)?;
                if let Some(read) = self.messages.get_mut(at) {
                    read.extended.insert(signal, Condition { multiplexer, values });
                }
            }
            _ => {}
        }
        Ok(())
    }

    /// Indices of a message and of a signal of it.
    fn place_of(&self, key: &str, name: &str) -> Result<(usize, usize), FaultKind> {
        let at = self.by_key.get(key).copied();
        let at = at.ok_or_else(|| FaultKind::Reference(format!("message {key}")))?;
        let mut signals = self.messages.get(at).into_iter().flat_map(|read| &read.message.signals);
        match signals.position(|signal| signal.name == name) {
            Some(signal) => Ok((at, signal)),
            None => Err(FaultKind::Reference(format!("signal {name} of message {key}"))),
        }
    }

    fn signal_of(&mut self, key: &str, name: &str) -> Result<&mut Signal, FaultKind> {
        let (at, signal) = self.place_of(key, name)?;
        let found = self.messages.get_mut(at).and_then(|read| read.message.signals.get_mut(signal));
        found.ok_or_else(|| FaultKind::Reference(format!("signal {name} of message {key}")))
    }

    fn finish(mut self) -> (Vec<Message>, Vec<DbcFault>) {
        let mut messages = Vec::new();
        for mut read in std::mem::take(&mut self.messages) {
            self.multiplex(&mut read);
            let (key, attributes) = (read.key, &self.attributes);
            let mut message = read.message;
            message.is_fd |= attributes.is_fd(key).unwrap_or(false);
            message.has_bit_rate_switch = attributes.has_bit_rate_switch(key).unwrap_or(true);
            for signal in &mut message.signals {
                let start = attributes.of_signal(START_VALUE, key, &signal.name);
                signal.initial = start.map_or(0, |value| signal.raw_of(value));
                let long = attributes.signals.get(&(LONG_SIGNAL, key, signal.name.as_str()));
                let long = long.map(|long| (*long).to_owned());
                signal.short_name = replaced(&mut signal.name, long);
            }
            let long = attributes.messages.get(&(LONG_MESSAGE, key));
            message.short_name = replaced(&mut message.name, long.map(|long| (*long).to_owned()));
            messages.push(message);
        }
        self.faults.sort_by_key(|fault| fault.line);
        (messages, self.faults)
    }

    /// Sets the conditions of multiplexed signals. Without a sound one a signal is left out, and the signals that it
    /// selects.
    fn multiplex(&mut self, read: &mut ReadMessage<'_>) {
        let multiplexers = read.multiplexing.iter().filter(|signal| signal.is_multiplexer);
        let count = multiplexers.count();
        let multiplexer = read.multiplexing.iter().position(|signal| signal.is_multiplexer);
        let mut faulty = Vec::new();
        for (at, signal) in read.message.signals.iter_mut().enumerate() {
            let value = read.multiplexing.get(at).and_then(|multiplexing| multiplexing.value);
            signal.condition = match (read.extended.remove(&at), value) {
                (Some(condition), _) => Some(condition),
                (None, None) => None,
                (None, Some(value)) => match multiplexer.filter(|_| count == 1) {
                    Some(multiplexer) => {
                        Some(Condition { multiplexer, values: vec![value..=value] })
                    }
                    None => {
                        let signal = signal.name.clone();
                        faulty.push((at, FaultKind::Multiplexer { signal, count }));
                        None
                    }
                },
            };
        }
        let signals = &read.message.signals;
        let above =
            |at: usize| signals.get(at)?.condition.as_ref().map(|condition| condition.multiplexer);
        let chain = |at: usize| std::iter::successors(above(at), |signal| above(*signal));
        for (at, signal) in signals.iter().enumerate() {
            // A chain without a cycle has at most as many links as signals.
            if chain(at).take(signals.len()).count() == signals.len() {
                faulty.push((at, FaultKind::MultiplexerCycle(signal.name.clone())));
            }
        }
        let is_left_out: Vec<bool> = (0..signals.len())
            .map(|at| {
                let mut links = std::iter::once(at).chain(chain(at).take(signals.len()));
                links.any(|link| faulty.iter().any(|(faulty, _)| *faulty == link))
            })
            .collect();
        for (at, kind) in faulty {
            let line = read.lines.get(at).copied().unwrap_or_default();
            self.faults.push(DbcFault { line, kind });
        }
        leave_out(&mut read.message.signals, &is_left_out);
    }
}

/// Leaves signals out, and corrects the indices of the multiplexers of the others.
fn leave_out(signals: &mut Vec<Signal>, is_left_out: &[bool]) {
    let left = |at: usize| is_left_out.get(at).copied().unwrap_or(false);
    let mut at = 0;
    signals.retain_mut(|signal| {
        if let Some(condition) = &mut signal.condition {
            let before = (0..condition.multiplexer).filter(|other| left(*other)).count();
            condition.multiplexer -= before;
        }
        at += 1;
        !left(at - 1)
    });
}

/// Takes the long name, if the file has one; returns the short one then.
fn replaced(name: &mut String, long: Option<String>) -> Option<String> {
    let long = long.filter(|long| !long.is_empty() && long != name)?;
    Some(std::mem::replace(name, long))
}

fn can_id(key: &str) -> Option<CanId> {
    let raw: u64 = key.parse().ok()?;
    let is_extended = raw & EXTENDED_FLAG != 0;
    CanId::new(u32::try_from(raw & !EXTENDED_FLAG).ok()?, is_extended).ok()
}

/// Values of attributes by message, or by message and signal, as texts.
#[derive(Debug, Default)]
struct Attributes<'a> {
    /// Values of attributes of kind ENUM.
    values: HashMap<&'a str, Vec<&'a str>>,
    defaults: HashMap<&'a str, &'a str>,
    messages: HashMap<(&'a str, &'a str), &'a str>,
    signals: HashMap<(&'a str, &'a str, &'a str), &'a str>,
}

impl<'a> Attributes<'a> {
    fn take(&mut self, item: Item<'a>) {
        match item {
            Item::Values { attribute, values } => _ = self.values.insert(attribute, values),
            Item::Default { attribute, value } => _ = self.defaults.insert(attribute, value),
            Item::Attribute { attribute, message, signal: None, value } => {
                self.messages.insert((attribute, message), value);
            }
            Item::Attribute { attribute, message, signal: Some(signal), value } => {
                self.signals.insert((attribute, message, signal), value);
            }
            _ => {}
        }
    }

    /// Returns whether the frame format of a message is CAN FD; `None` if the file does not state it.
    fn is_fd(&self, message: &str) -> Option<bool> {
        self.of_message(FRAME_FORMAT, message).map(|format| format.ends_with("_FD"))
    }

    fn has_bit_rate_switch(&self, message: &str) -> Option<bool> {
        self.of_message(BIT_RATE_SWITCH, message).map(|value| value != "0")
    }

    fn of_signal(&self, name: &str, message: &str, signal: &str) -> Option<&'a str> {
        let value = self.signals.get(&(name, message, signal));
        value.or_else(|| self.defaults.get(name)).copied()
    }

    /// An attribute of kind ENUM has the text of its index or the text itself.
    fn of_message(&self, name: &str, message: &str) -> Option<&str> {
        let value = *self.messages.get(&(name, message)).or_else(|| self.defaults.get(name))?;
        let values = self.values.get(name)?;
        let index = value.parse::<usize>().ok().filter(|_| !values.contains(&value));
        Some(index.and_then(|at| values.get(at)).map_or(value, |text| *text))
    }
}
