//! A database, and the signals of a frame.

use core::fmt;
use std::collections::HashMap;

use ecan_protocol::can::{CanFrame, CanId};

use super::faults::{DbcFault, DbcFaults};
use super::reader;
use super::signal::{Message, Number, Signal, UnknownName, find};

/// Messages of a DBC file.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Database {
    messages: Vec<Message>,
    warnings: Vec<DbcFault>,
    by_id: HashMap<(bool, u32), usize>,
}

impl Database {
    /// Parses a file in UTF-8 or Windows-1252. Messages and signals that cannot be used are left out, with a
    /// [warning](Self::warnings).
    ///
    /// # Errors
    /// The faults of a file in which no message can be used.
    pub fn parse(bytes: &[u8]) -> Result<Self, DbcFaults> {
        let (messages, warnings) = reader::read(&reader::text_of(bytes));
        if messages.is_empty() && !warnings.is_empty() {
            return Err(DbcFaults(warnings));
        }
        let by_id = messages.iter().enumerate().map(|(at, it)| (key(it.id), at)).collect();
        Ok(Self { messages, warnings, by_id })
    }

    /// What is left out of the file, in the order of its lines.
    #[must_use]
    pub fn warnings(&self) -> &[DbcFault] {
        &self.warnings
    }

    /// Messages in the order of the file.
    #[must_use]
    pub fn messages(&self) -> &[Message] {
        &self.messages
    }

    /// Message of a CAN ID.
    #[must_use]
    pub fn message(&self, id: CanId) -> Option<&Message> {
        self.messages.get(*self.by_id.get(&key(id))?)
    }

    /// Message of a name.
    ///
    /// # Errors
    /// No message has this name.
    pub fn message_named(&self, name: &str) -> Result<&Message, UnknownName> {
        let names = self.messages.iter().map(|message| message.name.as_str());
        let is_named =
            |message: &Message| message.name == name || message.short_name.as_deref() == Some(name);
        let at = match self.messages.iter().rposition(is_named) {
            Some(at) => at,
            None => find("message", name, names)?,
        };
        let unknown =
            || UnknownName { what: "message", name: name.to_owned(), similar: Vec::new() };
        self.messages.get(at).ok_or_else(unknown)
    }

    /// Decodes a frame; `None` if no message has its CAN ID.
    #[must_use]
    pub fn decode(&self, frame: &CanFrame) -> Option<Decoded<'_>> {
        self.message(frame.id()).map(|message| message.decode(frame))
    }
}

fn key(id: CanId) -> (bool, u32) {
    (id.is_extended(), id.raw())
}

/// Signals of a frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Decoded<'a> {
    /// Message of the CAN ID.
    pub message: &'a Message,
    /// Signals of the frame in the order of the file, without those that the multiplexers exclude.
    pub signals: Vec<DecodedSignal<'a>>,
    /// Number of signals that the frame is too short for.
    pub missing: usize,
}

/// Signal of a frame. `Display` writes `name = value unit (text)`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DecodedSignal<'a> {
    /// The signal.
    pub signal: &'a Signal,
    /// Physical value.
    pub value: Number,
    /// Text of the value, if it has one.
    pub text: Option<&'a str>,
}

impl DecodedSignal<'_> {
    /// Value with unit and text.
    #[must_use]
    pub fn value_text(&self) -> String {
        let mut shown = self.value.to_string();
        if !self.signal.unit.is_empty() {
            shown = format!("{shown} {}", self.signal.unit);
        }
        match self.text {
            Some(text) => format!("{shown} ({text})"),
            None => shown,
        }
    }
}

impl fmt::Display for DecodedSignal<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} = {}", self.signal.name, self.value_text())
    }
}

impl Message {
    /// Decodes a frame of this message. A remote frame has no signals.
    #[must_use]
    pub fn decode(&self, frame: &CanFrame) -> Decoded<'_> {
        let mut decoded = Decoded { message: self, signals: Vec::new(), missing: 0 };
        if frame.as_ref().is_remote() {
            return decoded;
        }
        let raw = |signal: &Signal| signal.layout.extract(frame.data());
        for (index, signal) in self.signals.iter().enumerate() {
            if !self.is_selected(index, &raw) {
                continue;
            }
            match raw(signal) {
                Some(raw) => decoded.signals.push(DecodedSignal {
                    signal,
                    value: signal.number(raw),
                    text: signal.text(raw),
                }),
                None => decoded.missing += 1,
            }
        }
        decoded
    }
}
