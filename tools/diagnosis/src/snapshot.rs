//! Values of a gateway as plain data, for analysis and files.

use std::collections::BTreeMap;
use std::fmt;
use std::str::FromStr;

use ecan_protocol::config::FilterWindow;
use ecan_protocol::device::{AlState, AlStatusCode};
use ecan_protocol::object::object;
use serde::{Deserialize, Deserializer, Serialize, Serializer};

/// Entry of the object dictionary; as text `0x8010:02` with a decimal subindex, as in the manual.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct ObjectKey {
    /// Index.
    pub index: u16,
    /// Subindex.
    pub subindex: u8,
}

impl fmt::Display for ObjectKey {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "0x{:04X}:{:02}", self.index, self.subindex)
    }
}

impl FromStr for ObjectKey {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let parts = text.strip_prefix("0x").and_then(|rest| rest.split_once(':'));
        let key = parts.and_then(|(index, subindex)| {
            let index = u16::from_str_radix(index, 16).ok()?;
            Some(Self { index, subindex: subindex.parse().ok()? })
        });
        key.ok_or_else(|| format!("invalid object \"{text}\"; expected for example 0x8010:02"))
    }
}

impl Serialize for ObjectKey {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

impl<'de> Deserialize<'de> for ObjectKey {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        String::deserialize(deserializer)?.parse().map_err(serde::de::Error::custom)
    }
}

/// Error of reading an entry.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum ReadError {
    /// The gateway rejected this entry; other entries may be readable.
    Rejected(String),
    /// The gateway does not respond; further reads are pointless.
    Silent(String),
}

/// Amount of data to read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Depth {
    /// Entries for findings: about 420, plus 23 per channel whose configuration was not applied.
    Findings,
    /// In addition the whole channel configuration and the capabilities, about 650 entries.
    Everything,
}

/// Values of one gateway.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Snapshot {
    /// Position of the slave.
    pub position: u16,
    /// AL state from the master: 1 INIT, 2 PREOP, 3 BOOT, 4 SAFEOP, 8 OP; bit 4 is the error flag.
    /// 0 if unknown.
    pub al_state: u8,
    /// Whether the master set the error flag and keeps the slave in its state.
    pub has_error_flag: bool,
    /// AL status code, ESC register 0x0134; `None` if not read.
    pub al_status_code: Option<u16>,
    /// Values by object.
    pub values: BTreeMap<ObjectKey, u32>,
    /// Rejected entries with reasons.
    pub rejected: BTreeMap<ObjectKey, String>,
    /// Reason for an early end of reading.
    pub silence: Option<String>,
}

/// Objects for findings.
const FINDING_OBJECTS: [u16; 22] = [
    0x1C12, 0x1C13, 0x8000, 0x8001, 0x8002, 0x8003, 0x8004, 0x8010, 0x8011, 0x8020, 0x8021, 0x8022,
    0x8023, 0x8024, 0x8030, 0x9000, 0x9001, 0x9002, 0x9003, 0x9011, 0xB000, 0xF000,
];
/// Data path diagnostics.
const DATA_PATH_OBJECTS: [u16; 4] = [0x9020, 0x9021, 0x9022, 0x9023];
/// Entries of the channel configuration for findings.
const CHANNEL_ENTRIES: [u8; 18] =
    [2, 4, 7, 8, 9, 15, 16, 18, 19, 20, 21, 22, 23, 24, 33, 34, 49, 55];
/// Additional entries if the configuration of a channel was not applied: manual bit timing,
/// non-match policies, Message RAM.
const APPLY_ENTRIES: [u8; 23] =
    [25, 26, 27, 28, 29, 30, 31, 32, 36, 37, 61, 62, 63, 64, 65, 66, 67, 68, 69, 70, 71, 72, 73];
/// Entries of the capabilities.
const CAPABILITY_ENTRIES: [u8; 9] = [1, 3, 4, 5, 6, 7, 8, 11, 29];

impl Snapshot {
    /// Reads the values of a gateway with `read`, which uploads one entry. The caller sets the
    /// states of the slave.
    ///
    /// Stops if the gateway does not respond, and sets [`silence`](Self::silence).
    pub fn read(depth: Depth, mut read: impl FnMut(ObjectKey) -> Result<u32, ReadError>) -> Self {
        let mut snapshot = Self::default();
        for index in FINDING_OBJECTS.into_iter().chain(DATA_PATH_OBJECTS) {
            for subindex in subindices(index, depth) {
                let key = ObjectKey { index, subindex };
                // There are no entries after the count of an assignment.
                if is_assignment(index)
                    && snapshot.get(index, 0).is_some_and(|it| it < subindex.into())
                {
                    break;
                }
                if depth == Depth::Findings && !snapshot.explains_a_finding(key) {
                    continue;
                }
                match read(key) {
                    Ok(value) => {
                        snapshot.values.insert(key, value);
                    }
                    Err(ReadError::Rejected(why)) => {
                        snapshot.rejected.insert(key, why);
                    }
                    Err(ReadError::Silent(why)) => {
                        snapshot.silence = Some(why);
                        return snapshot;
                    }
                }
            }
        }
        snapshot
    }

    /// Returns whether an entry is needed for findings, given the values read before.
    fn explains_a_finding(&self, key: ObjectKey) -> bool {
        let is_channel = (0x8001..=0x8004).contains(&key.index);
        let tells_of_apply = is_channel && APPLY_ENTRIES.contains(&key.subindex);
        !tells_of_apply || self.get(key.index, 2).is_some_and(|status| status != 0)
    }

    /// Value that was read.
    pub fn get(&self, index: u16, subindex: u8) -> Option<u32> {
        self.values.get(&ObjectKey { index, subindex }).copied()
    }

    /// Value formatted by `text`, or "unknown" if it was not read.
    pub(crate) fn text_of(&self, index: u16, subindex: u8, text: impl Fn(u32) -> String) -> String {
        self.get(index, subindex).map_or_else(|| "unknown".to_owned(), text)
    }

    pub(crate) fn number(&self, index: u16, subindex: u8) -> String {
        self.text_of(index, subindex, |value| value.to_string())
    }

    /// Sets a value.
    pub fn set(&mut self, index: u16, subindex: u8, value: u32) {
        self.values.insert(ObjectKey { index, subindex }, value);
    }

    /// AL state; `None` for an invalid number.
    pub fn state(&self) -> Option<AlState> {
        AlState::from_status(self.al_state.into())
    }

    /// AL status code, if it was read and is an error.
    pub fn status_code(&self) -> Option<AlStatusCode> {
        self.al_status_code.filter(|code| *code != 0).map(AlStatusCode)
    }

    /// Returns whether the profile of a direction (0x8010 or 0x8011) is active.
    pub(crate) fn active_bytes(&self, index: u16) -> Option<u32> {
        self.get(index, 9).filter(|bytes| *bytes != 0)
    }

    /// Channel mask of the active profile of a direction.
    pub(crate) fn active_mask(&self, index: u16) -> Option<u32> {
        self.active_bytes(index)?;
        Some(self.get(index, 12)? >> 5 & 0xFF)
    }
}

fn is_assignment(index: u16) -> bool {
    matches!(index, 0x1C12 | 0x1C13)
}

/// The editing windows show one filter at a time and are not state.
fn is_filter_in_window(subindex: u8) -> bool {
    FilterWindow::BOTH.iter().any(|window| {
        [window.index, window.command, window.status].contains(&subindex)
            || window.fields().contains(&subindex)
    })
}

/// Subindices to read of an object, in ascending order.
fn subindices(index: u16, depth: Depth) -> impl Iterator<Item = u8> {
    let entries = object(index).map_or(&[][..], |object| object.entries);
    let is_wanted = move |subindex: u8| match (index, depth) {
        (0x1C12 | 0x1C13, _) => true,
        (_, _) if subindex == 0 => false,
        (0x8001..=0x8004, Depth::Findings) => {
            CHANNEL_ENTRIES.contains(&subindex) || APPLY_ENTRIES.contains(&subindex)
        }
        (0x8001..=0x8004, Depth::Everything) => !is_filter_in_window(subindex),
        (0xF000, Depth::Findings) => CAPABILITY_ENTRIES.contains(&subindex),
        _ => true,
    };
    entries
        .iter()
        .filter(|entry| entry.access.can_read() && entry.ty.is_integer())
        .filter(|entry| !entry.name.starts_with("Reserved"))
        .map(|entry| entry.subindex)
        .filter(move |subindex| is_wanted(*subindex))
}
