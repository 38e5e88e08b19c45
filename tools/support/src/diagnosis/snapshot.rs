//! Values of a gateway as plain data, for analysis and files.

use std::collections::BTreeMap;
use std::fmt;
use std::str::FromStr;

use ecan_protocol::config::{ConfigObject, FilterWindow, McanChannelConfig};
use ecan_protocol::device::{AlState, AlStatusCode};
use ecan_protocol::image::{ChannelState, ChannelStatus};
use ecan_protocol::mapping::SyncManagerLayout;
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
    /// Entries for the report and its findings: about 50 of a gateway without active profile and
    /// channels, up to 190 in operation, plus those of a configuration that was not applied.
    Findings,
    /// Everything that is state: about 650 entries.
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
    /// True if the master set the error flag and keeps the slave in its state.
    pub has_error_flag: bool,
    /// AL status code, ESC register 0x0134; `None` if not read.
    pub al_status_code: Option<u16>,
    /// Period of Sync0 in nanoseconds, ESC register 0x09A0; `None` if not read.
    #[serde(default)]
    pub sync0_period_ns: Option<u32>,
    /// SM2 and SM3, ESC registers 0x0810 to 0x081F; `None` if not read.
    #[serde(default)]
    pub sync_managers: Option<[[u8; SyncManagerLayout::BYTES]; 2]>,
    /// Values by object.
    pub values: BTreeMap<ObjectKey, u32>,
    /// Rejected entries with reasons.
    pub rejected: BTreeMap<ObjectKey, String>,
    /// Reason for an early end of reading.
    pub silence: Option<String>,
}

/// Objects to read; the first ones decide which entries of the others are needed.
const OBJECTS: [u16; 26] = [
    0x8010, 0x8011, 0x9000, 0x9001, 0x9002, 0x9003, 0x8001, 0x8002, 0x8003, 0x8004, 0x9020, 0x9021,
    0x9022, 0x9023, 0x8000, 0x1C12, 0x1C13, 0x8020, 0x8021, 0x8022, 0x8023, 0x8024, 0x8030, 0x9011,
    0xB000, 0xF000,
];
/// Channel status (0x9000 to 0x9003), read before the other entries of its object.
const CHANNEL_STATUS: u8 = 9;

impl Snapshot {
    /// Reads the values of a gateway with `read`, which uploads one entry. The caller sets the
    /// states of the slave.
    ///
    /// Stops if the gateway does not respond, and sets [`silence`](Self::silence).
    pub fn read(depth: Depth, mut read: impl FnMut(ObjectKey) -> Result<u32, ReadError>) -> Self {
        let mut snapshot = Self::default();
        for index in OBJECTS {
            for subindex in subindices(index) {
                let is_needed = match depth {
                    Depth::Findings => snapshot.explains_a_finding(index, subindex),
                    Depth::Everything => snapshot.is_state(index, subindex),
                };
                if !is_needed {
                    continue;
                }
                let key = ObjectKey { index, subindex };
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

    /// Returns whether an entry has a meaning.
    fn is_state(&self, index: u16, subindex: u8) -> bool {
        match index {
            // There are no entries after the count of an assignment.
            0x1C12 | 0x1C13 => {
                subindex == 0 || self.get(index, 0).is_none_or(|count| count >= subindex.into())
            }
            0x8001..=0x8004 => subindex != 0 && !is_filter_in_window(subindex),
            _ => subindex != 0,
        }
    }

    /// Returns whether an entry is needed for the report and its findings, given the values read
    /// before.
    fn explains_a_finding(&self, index: u16, subindex: u8) -> bool {
        let is_not =
            |index, subindex, value| self.get(index, subindex).is_some_and(|found| found != value);
        let is_unapplied = |channel: u16| is_not(0x8001 + channel, 2, 0);
        match (index, subindex) {
            (0x1C12 | 0x1C13, 0) => true,
            (_, 0) | (0x1C12 | 0x1C13, _) => false,
            (0x8000, 4 | 11 | 13 | 15) => true,
            (0x8000, 6..=9) => is_unapplied(u16::from(subindex) - 6),
            (0x8001..=0x8004, 2 | 4) => true,
            // The settings of CAN FD, and of a channel that may reject every frame.
            (0x8001..=0x8004, 65 | 66 | 72) if !self.is_unused(index - 0x8001) => {
                is_unapplied(index - 0x8001) || self.get(index, 15) == Some(1)
            }
            (0x8001..=0x8004, 49 | 55) if !self.is_unused(index - 0x8001) => {
                is_not(index, 36, 0) && is_not(index, 37, 0)
            }
            (0x8001..=0x8004, 7..=9 | 15 | 16 | 19..=24 | 33 | 34 | 36 | 37) => {
                is_unapplied(index - 0x8001) || !self.is_unused(index - 0x8001)
            }
            (0x8001..=0x8004, _) => {
                is_unapplied(index - 0x8001)
                    && McanChannelConfig::fields().any(|entry| entry.subindex == subindex)
            }
            (0x8010 | 0x8011, 2 | 9 | 14..=16) => true,
            (0x8010 | 0x8011, 3 | 4) => is_not(index, 2, 0),
            (0x8010 | 0x8011, 10 | 12) => is_not(index, 9, 0),
            (0x8020, 3) => true,
            (0x8021..=0x8024, 1 | 3) => true,
            (0x8021..=0x8024, 14) => !self.is_unused(index - 0x8021),
            (0x8030, 2..=6) => true,
            (0x9000..=0x9003, CHANNEL_STATUS) => true,
            (0x9000..=0x9003, 1..=8 | 13..=15) => !self.is_unused(index - 0x9000),
            (0x9011, 1..=13) => [0x8010, 0x8011].into_iter().any(|object| is_not(object, 9, 0)),
            (0x9020..=0x9023, 2 | 5 | 11 | 12 | 15 | 16) => !self.is_unused(index - 0x9020),
            (0x9020..=0x9023, 6..=8) => is_not(index, 5, 0),
            (0xB000, 2 | 5 | 6) => true,
            (0xF000, 7 | 8) => true,
            _ => false,
        }
    }

    /// Returns whether a channel is disabled, and therefore was since the start of the gateway: no
    /// command disables a channel (manual 13.4).
    fn is_unused(&self, channel: u16) -> bool {
        self.get(0x9000 + channel, CHANNEL_STATUS).is_some_and(|raw| {
            let status = ChannelStatus::from_raw(raw as u16);
            status.state() == ChannelState::Disabled && !status.bus_off()
        })
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

/// The editing windows show one filter at a time and are not state.
fn is_filter_in_window(subindex: u8) -> bool {
    FilterWindow::BOTH.iter().any(|window| {
        [window.index, window.command, window.status].contains(&subindex)
            || window.fields().contains(&subindex)
    })
}

/// Readable numbers of an object in ascending order, the channel status first.
fn subindices(index: u16) -> impl Iterator<Item = u8> {
    let entries = object(index).map_or(&[][..], |object| object.entries);
    let readable = entries
        .iter()
        .filter(|entry| entry.access.can_read() && entry.ty.is_integer())
        .filter(|entry| !entry.name.starts_with("Reserved"))
        .map(|entry| entry.subindex);
    let is_channel = (0x9000..=0x9003).contains(&index);
    let is_first = move |subindex: &u8| is_channel && *subindex == CHANNEL_STATUS;
    let rest = readable.clone().filter(move |subindex| !is_first(subindex));
    readable.filter(move |subindex| is_first(subindex)).chain(rest)
}
