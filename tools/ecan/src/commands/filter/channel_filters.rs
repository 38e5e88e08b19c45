//! Filters of a channel through its editing window, and new filters of the command line.

use clap::builder::{PossibleValuesParser, TypedValueParser};
use clap::{ArgGroup, Args};
use ecan_protocol::config::{
    ApplyStatus, ExtendedFilter, ExtendedMatch, FilterAction, FilterCommand, FilterCommandStatus,
    FilterElementFault, FilterWindow, McanChannelConfig, StandardFilter, StandardMatch,
};
use ecan_protocol::image::{ChannelState, ChannelStatus};
use serde::Serialize;

use crate::context::{Bus, Failure, Result};
use crate::value::parse_unsigned;

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
        let count = |subindex| self.get(subindex).map(|raw| u8::try_from(raw).unwrap_or(u8::MAX));
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

#[derive(Debug, Args)]
#[command(group = ArgGroup::new("identifiers").required(true).args(["id", "range", "mask"]))]
pub(super) struct NewFilter {
    /// Filter 29-bit CAN IDs
    #[arg(long)]
    extended: bool,
    /// Match one or two CAN IDs
    #[arg(long, num_args = 1..=2, value_name = "ID", value_parser = parse_identifier)]
    id: Vec<u32>,
    /// Match CAN IDs from FIRST to LAST
    #[arg(long, num_args = 2, value_names = ["FIRST", "LAST"], value_parser = parse_identifier)]
    range: Vec<u32>,
    /// Match CAN IDs that equal ID in the bits of MASK
    #[arg(long, num_args = 2, value_names = ["ID", "MASK"], value_parser = parse_identifier)]
    mask: Vec<u32>,
    /// Do not apply the global mask 0x8001:40 to the range
    #[arg(long, requires = "range", requires = "extended")]
    unmasked: bool,
    /// Action for matching frames
    #[arg(long, value_parser = action_parser(), default_value = "fifo0", value_name = "WHERE")]
    to: FilterAction,
    /// Store matching frames in this receive buffer; only with one --id
    #[arg(long, value_name = "N", conflicts_with_all = ["to", "range", "mask"])]
    buffer: Option<u8>,
    /// Mark matching frames as sync messages for the timestamp unit
    #[arg(long)]
    sync: bool,
}

fn action_parser() -> impl TypedValueParser<Value = FilterAction> {
    let actions = [
        ("fifo0", FilterAction::Fifo0),
        ("fifo1", FilterAction::Fifo1),
        ("reject", FilterAction::Reject),
        ("priority", FilterAction::Priority),
        ("priority-fifo0", FilterAction::PriorityFifo0),
        ("priority-fifo1", FilterAction::PriorityFifo1),
    ];
    PossibleValuesParser::new(actions.map(|(name, _)| name)).map(move |name| {
        actions.iter().find(|action| action.0 == name).map_or(actions[0].1, |action| action.1)
    })
}

fn parse_identifier(text: &str) -> Result<u32, String> {
    let value = parse_unsigned(text).ok_or_else(|| format!("invalid CAN ID \"{text}\""))?;
    u32::try_from(value).map_err(|_| format!("{text} is out of range; allowed: 0 to 0x1FFFFFFF"))
}

#[derive(Clone, Copy, Debug)]
pub(super) enum Filter {
    Standard(StandardFilter),
    Extended(ExtendedFilter),
}

impl NewFilter {
    /// Builds the filter. [`Filter::check`] reports CAN IDs that do not fit; only those that the
    /// type cannot hold are rejected here.
    pub(super) fn build(&self) -> Result<Filter, String> {
        let (matching, ids) = match (&self.id[..], &self.range[..], &self.mask[..]) {
            ([one], _, _) => (ExtendedMatch::Two, [*one, *one]),
            ([one, two], _, _) => (ExtendedMatch::Two, [*one, *two]),
            (_, [first, last], _) if self.unmasked => {
                (ExtendedMatch::RangeUnmasked, [*first, *last])
            }
            (_, [first, last], _) => (ExtendedMatch::Range, [*first, *last]),
            (_, _, [id, mask]) => (ExtendedMatch::Masked, [*id, *mask]),
            _ => return Err("one of --id, --range or --mask is required".to_owned()),
        };
        let (action, sync) = (self.buffer.map_or(self.to, FilterAction::RxBuffer), self.sync);
        if self.buffer.is_some() && self.id.len() > 1 {
            return Err("a receive buffer needs exactly one --id".to_owned());
        }
        let [id1, id2] = ids;
        if self.extended {
            return Ok(Filter::Extended(ExtendedFilter { matching, action, sync, id1, id2 }));
        }
        let matching = match matching {
            ExtendedMatch::Two => StandardMatch::Two,
            ExtendedMatch::Masked => StandardMatch::Masked,
            _ => StandardMatch::Range,
        };
        let short = |id: u32| {
            u16::try_from(id).ok().filter(|id| *id <= 0x7FF).ok_or_else(|| {
                format!("0x{id:X} is out of range; allowed: 0 to 0x7FF; use --extended for 29-bit CAN IDs")
            })
        };
        let (id1, id2) = (short(id1)?, short(id2)?);
        Ok(Filter::Standard(StandardFilter { matching, action, sync, id1, id2 }))
    }
}

impl Filter {
    pub(super) fn kind(&self) -> Kind {
        match self {
            Self::Standard(_) => Kind::Standard,
            Self::Extended(_) => Kind::Extended,
        }
    }

    pub(super) fn check(&self, counts: ElementCounts) -> Result<(), String> {
        let mut config = McanChannelConfig::default();
        config.ram.rx_fifo0.size = counts.fifo0;
        config.ram.rx_fifo1.size = counts.fifo1;
        config.ram.rx_buffer_count = counts.buffers;
        let mut faults = Vec::new();
        let kind = self.kind().name();
        let mut report = |fault: FilterElementFault| faults.push(format!("{kind} filter: {fault}"));
        match self {
            Self::Standard(filter) => filter.check(&config, &mut report),
            Self::Extended(filter) => filter.check(&config, &mut report),
        }
        if faults.is_empty() { Ok(()) } else { Err(faults.join("; ")) }
    }

    pub(super) fn raw(&self) -> RawFilter {
        let (matching, action, sync, id1, id2) = match self {
            Self::Standard(filter) => (
                filter.matching.raw(),
                filter.action,
                filter.sync,
                filter.id1.into(),
                filter.id2.into(),
            ),
            Self::Extended(filter) => {
                (filter.matching.raw(), filter.action, filter.sync, filter.id1, filter.id2)
            }
        };
        let id2 = match action {
            FilterAction::RxBuffer(buffer) => buffer.into(),
            _ => id2,
        };
        RawFilter {
            matching: matching.into(),
            action: action.raw().into(),
            sync: sync.into(),
            id1,
            id2,
        }
    }
}
