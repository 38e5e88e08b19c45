//! Messages of a file.

use std::collections::HashMap;

use ecan_protocol::can::{CanFrame, CanId};

use crate::dbc::decode::Decoded;
use crate::dbc::fault::DbcFaults;
use crate::dbc::message::Message;
use crate::dbc::reader;
use crate::dbc::similar::{UnknownName, find};

/// Messages of a DBC file.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Database {
    messages: Vec<Message>,
    by_id: HashMap<(bool, u32), usize>,
}

impl Database {
    /// Parses a file in UTF-8 or Windows-1252.
    ///
    /// # Errors
    /// A syntax error, or all other faults.
    pub fn parse(bytes: &[u8]) -> Result<Self, DbcFaults> {
        let messages = reader::read(bytes)?;
        let by_id = messages.iter().enumerate().map(|(at, it)| (key(it.id), at)).collect();
        Ok(Self { messages, by_id })
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
        let names = self.messages.iter().map(|it| it.name.as_str());
        let at = find("message", name, names)?;
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
