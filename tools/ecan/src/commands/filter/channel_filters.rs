use ecan_protocol::config::{ApplyStatus, FilterCommand, FilterCommandStatus, FilterWindow};
use ecan_protocol::image::{ChannelState, ChannelStatus};
use serde::Serialize;

use crate::context::{Bus, Failure, Result};

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    Standard,
    Extended,
}

impl Kind {
    pub const ALL: [Self; 2] = [Self::Standard, Self::Extended];

    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Standard => "standard",
            Self::Extended => "extended",
        }
    }

    fn window(self) -> FilterWindow {
        match self {
            Self::Standard => FilterWindow::STANDARD,
            Self::Extended => FilterWindow::EXTENDED,
        }
    }
}

/// Filter in the numbers of the editing window.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct RawFilter {
    #[serde(rename = "type")]
    pub matching: u32,
    pub action: u32,
    pub sync: u32,
    pub id1: u32,
    pub id2: u32,
}

/// Number of filters in the Message RAM configuration.
#[derive(Clone, Copy, Debug)]
pub(super) struct ElementCounts {
    pub(super) fifo0: u8,
    pub(super) fifo1: u8,
    pub(super) buffers: u8,
}

pub struct ChannelFilters<'a> {
    pub bus: &'a Bus,
    pub slave: usize,
    pub channel: u8,
}

impl ChannelFilters<'_> {
    fn object(&self) -> u16 {
        0x8001 + u16::from(self.channel)
    }

    fn get(&self, subindex: u8) -> Result<u32> {
        self.bus.read(self.slave, self.object(), subindex)
    }

    fn set(&self, subindex: u8, value: u32) -> Result {
        self.bus.write(self.slave, self.object(), subindex, value)
    }

    /// Non-match policies: standard, extended.
    pub(super) fn non_match(&self) -> Result<[u32; 2]> {
        Ok([self.get(36)?, self.get(37)?])
    }

    pub(super) fn extended_mask(&self) -> Result<u32> {
        self.get(40)
    }

    pub(super) fn element_counts(&self) -> Result<ElementCounts> {
        let count = |subindex| self.get(subindex).map(|it| u8::try_from(it).unwrap_or(u8::MAX));
        Ok(ElementCounts { fifo0: count(62)?, fifo1: count(64)?, buffers: count(67)? })
    }

    /// Returns whether the channel runs, so that an apply changes only the filters.
    pub(super) fn is_running(&self) -> Result<bool> {
        let raw = self.bus.read(self.slave, 0x9000 + u16::from(self.channel), 9)?;
        Ok(ChannelStatus::from_raw(raw as u16).state() != ChannelState::Disabled)
    }

    pub(super) fn apply(&self) -> Result {
        self.set(1, 1)?;
        let status = ApplyStatus::from_raw(u8::try_from(self.get(2)?).unwrap_or(u8::MAX));
        if status == ApplyStatus::Ok {
            return Ok(());
        }
        let message = format!("CAN{}: configuration not applied, status {status}", self.channel);
        Err(Failure::Rejected(format!("{message}; the previous one stays active")))
    }

    pub fn read(&self, kind: Kind) -> Result<Vec<RawFilter>> {
        let window = kind.window();
        (0..self.get(window.count)?).map(|number| self.load(kind, number)).collect()
    }

    fn load(&self, kind: Kind, number: u32) -> Result<RawFilter> {
        self.command(kind, number, FilterCommand::Load)?;
        let first = kind.window().first_field;
        let field = |offset| self.get(first + offset);
        Ok(RawFilter {
            matching: field(0)?,
            action: field(1)?,
            sync: field(2)?,
            id1: field(3)?,
            id2: field(4)?,
        })
    }

    fn save(&self, kind: Kind, number: u32, filter: &RawFilter) -> Result {
        let values = [filter.matching, filter.action, filter.sync, filter.id1, filter.id2];
        for (subindex, value) in kind.window().fields().zip(values) {
            self.set(subindex, value)?;
        }
        self.command(kind, number, FilterCommand::Save)
    }

    fn command(&self, kind: Kind, number: u32, command: FilterCommand) -> Result {
        let window = kind.window();
        self.set(window.index, number)?;
        self.set(window.command, command.raw().into())?;
        let status = self.get(window.status)?;
        let reason = match u8::try_from(status).ok().and_then(FilterCommandStatus::from_raw) {
            Some(FilterCommandStatus::Ok) => return Ok(()),
            Some(FilterCommandStatus::InvalidIndex) => "invalid index".to_owned(),
            Some(FilterCommandStatus::InvalidCommand) => "invalid command".to_owned(),
            None => format!("unknown status {status}"),
        };
        let name = kind.name();
        Err(Failure::Rejected(format!("{name} filter {number} of CAN{}: {reason}", self.channel)))
    }

    pub(super) fn append(&self, kind: Kind, filter: RawFilter) -> Result {
        let window = kind.window();
        let (count, max) = (self.get(window.count)?, self.get(window.max)?);
        if count >= max {
            let name = kind.name();
            return Err(Failure::Usage(format!("no free {name} filter; {max} are in use")));
        }
        self.save(kind, count, &filter)?;
        self.set(window.count, count + 1)
    }

    pub(super) fn remove(&self, kind: Kind, number: u8) -> Result {
        let mut filters = self.read(kind)?;
        if usize::from(number) >= filters.len() {
            let name = kind.name();
            let message = match filters.len() {
                0 => format!("CAN{}: no {name} filters", self.channel),
                1 => format!(
                    "CAN{}: invalid filter number; allowed for {name} filters: 0",
                    self.channel
                ),
                more => format!(
                    "CAN{}: invalid filter number; allowed for {name} filters: 0 to {}",
                    self.channel,
                    more - 1
                ),
            };
            return Err(Failure::Usage(message));
        }
        filters.remove(number.into());
        self.replace(kind, &filters)
    }

    /// Writes a whole list and disables the filters after it.
    pub fn replace(&self, kind: Kind, filters: &[RawFilter]) -> Result {
        let window = kind.window();
        let before = self.get(window.count)?;
        for (number, filter) in (0..).zip(filters) {
            self.save(kind, number, filter)?;
        }
        let count = u32::try_from(filters.len()).unwrap_or(before);
        self.set(window.count, count)?;
        (count..before).try_for_each(|number| self.command(kind, number, FilterCommand::Clear))
    }
}
