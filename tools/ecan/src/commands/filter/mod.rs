//! `ecan filter`: acceptance filters of a channel through the editing window (manual 13.4).

mod channel_filters;
#[cfg(test)]
mod tests;

use std::io::Write;

pub use channel_filters::{ChannelFilters, Kind as FilterKind, RawFilter};
use channel_filters::{Kind, NewFilter};
use clap::{Args, Subcommand};
use ecan_protocol::config::{ExtendedMatch, FilterAction, NonMatch, StandardMatch};
use serde::Serialize;

use crate::context::{Context, Failure, Result, note};
use crate::frames::ChannelArgument;
use crate::output;

#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  ecan filter list --channel 0
  ecan filter add --channel 0 --range 0x180 0x1FF
  ecan filter add --channel 0 --id 0x80 --to priority-fifo0
  ecan filter add --channel 0 --extended --mask 0x18FF0000 0x1FFF0000 --to fifo1
  ecan filter remove 1 --channel 0
  ecan filter clear --channel 0

Filters take effect when the channel is applied, which restarts it. A running channel is applied
immediately, unless --no-apply is given. To keep filters after a power cycle, run `ecan config save`.")]
pub struct FilterArguments {
    #[command(subcommand)]
    action: Action,
}

#[derive(Debug, Subcommand)]
enum Action {
    /// List the filters and the non-match policies
    List {
        #[command(flatten)]
        channel: ChannelArgument,
    },
    /// Append a filter
    Add {
        #[command(flatten)]
        channel: ChannelArgument,
        #[command(flatten)]
        filter: NewFilter,
        #[command(flatten)]
        apply: ApplyArgument,
    },
    /// Remove a filter; the following filters move up
    Remove {
        /// Number in the list
        number: u8,
        #[command(flatten)]
        channel: ChannelArgument,
        /// Select the list for 29-bit CAN IDs
        #[arg(long)]
        extended: bool,
        #[command(flatten)]
        apply: ApplyArgument,
    },
    /// Remove all filters, or all of one kind
    Clear {
        #[command(flatten)]
        channel: ChannelArgument,
        /// Remove filters for 11-bit CAN IDs only
        #[arg(long, conflicts_with = "extended")]
        standard: bool,
        /// Remove filters for 29-bit CAN IDs only
        #[arg(long)]
        extended: bool,
        #[command(flatten)]
        apply: ApplyArgument,
    },
}

#[derive(Debug, Args)]
struct ApplyArgument {
    /// Do not apply; the filters take effect at the next apply
    #[arg(long)]
    no_apply: bool,
}

/// Filters of a channel.
#[derive(Debug, Serialize)]
struct Listed {
    position: usize,
    channel: u8,
    non_match_standard: &'static str,
    non_match_extended: &'static str,
    extended_mask: u32,
    standard: Vec<ListedFilter>,
    extended: Vec<ListedFilter>,
}

#[derive(Debug, Serialize)]
struct ListedFilter {
    number: usize,
    identifiers: String,
    action: String,
    is_sync: bool,
    raw: RawFilter,
}

pub fn run(arguments: &FilterArguments, context: &Context) -> Result {
    let (channel, no_apply) = match &arguments.action {
        Action::List { channel } => (channel, true),
        Action::Add { channel, apply, .. }
        | Action::Remove { channel, apply, .. }
        | Action::Clear { channel, apply, .. } => (channel, apply.no_apply),
    };
    let new = match &arguments.action {
        Action::Add { filter, .. } => Some(filter.build().map_err(Failure::Usage)?),
        _ => None,
    };
    let bus = context.bus()?;
    let filters = ChannelFilters { bus: &bus, slave: bus.slave()?, channel: channel.channel };
    match &arguments.action {
        Action::List { .. } => {}
        Action::Add { .. } => {
            if let Some(filter) = &new {
                filter.check(filters.element_counts()?).map_err(Failure::Usage)?;
                filters.append(filter.kind(), filter.raw())?;
            }
        }
        Action::Remove { number, extended, .. } => filters.remove(kind(*extended), *number)?,
        Action::Clear { standard, extended, .. } => {
            if !extended {
                filters.replace(Kind::Standard, &[])?;
            }
            if !standard {
                filters.replace(Kind::Extended, &[])?;
            }
        }
    }
    if !no_apply {
        if filters.is_running()? {
            filters.apply()?;
        } else {
            let message = "is off: filters take effect at the next apply";
            note(format_args!("CAN{} {message}", channel.channel));
        }
    }
    let listed = list(&filters)?;
    context.output.data(&listed, |out| print(&listed, out))
}

fn kind(is_extended: bool) -> Kind {
    if is_extended { Kind::Extended } else { Kind::Standard }
}

fn list(filters: &ChannelFilters) -> Result<Listed> {
    let of_kind = |kind| {
        let raw = filters.read(kind)?;
        let listed = raw.into_iter().enumerate().map(|(number, raw)| ListedFilter {
            number,
            identifiers: identifiers_text(kind, &raw),
            action: action_text(&raw),
            is_sync: raw.sync != 0,
            raw,
        });
        Ok::<_, Failure>(listed.collect())
    };
    let [standard, extended] = filters.non_match()?;
    Ok(Listed {
        position: filters.slave,
        channel: filters.channel,
        non_match_standard: non_match_text(standard),
        non_match_extended: non_match_text(extended),
        extended_mask: filters.extended_mask()?,
        standard: of_kind(Kind::Standard)?,
        extended: of_kind(Kind::Extended)?,
    })
}

fn print(listed: &Listed, out: &mut dyn Write) -> std::io::Result<()> {
    let Listed { channel, non_match_standard, non_match_extended, extended_mask, .. } = listed;
    let rules = [
        ("standard", non_match_standard, &listed.standard),
        ("extended", non_match_extended, &listed.extended),
    ];
    for (name, non_match, filters) in rules {
        let count = match filters.len() {
            0 => "no filters".to_owned(),
            1 => "1 filter".to_owned(),
            more => format!("{more} filters"),
        };
        let mask = match name {
            "extended" if *extended_mask != 0x1FFF_FFFF => {
                format!("; CAN IDs are masked with 0x{extended_mask:08X}")
            }
            _ => String::new(),
        };
        writeln!(out, "CAN{channel} {name}: {count}; other frames: {non_match}{mask}")?;
        output::print(out, filters, |filter| {
            let sync = if filter.is_sync { "sync message" } else { "" };
            [
                format!("  {}", filter.number),
                filter.identifiers.clone(),
                filter.action.clone(),
                sync.into(),
            ]
        })?;
    }
    Ok(())
}

fn identifiers_text(kind: Kind, filter: &RawFilter) -> String {
    let RawFilter { id1, id2, .. } = *filter;
    let digits = if kind == Kind::Standard { 3 } else { 8 };
    let id = |id| format!("0x{id:0digits$X}");
    if matches!(decode_action(filter), Some(FilterAction::RxBuffer(_))) {
        return id(id1);
    }
    let raw = u8::try_from(filter.matching).unwrap_or(u8::MAX);
    let range = || format!("{} to {}", id(id1), id(id2));
    let two = || match id1 == id2 {
        true => id(id1),
        false => format!("{} and {}", id(id1), id(id2)),
    };
    let masked = || format!("{} in the bits of {}", id(id1), id(id2));
    let unknown = || format!("unknown type {}", filter.matching);
    match kind {
        Kind::Standard => match StandardMatch::from_raw(raw) {
            Some(StandardMatch::Range) => range(),
            Some(StandardMatch::Two) => two(),
            Some(StandardMatch::Masked) => masked(),
            Some(StandardMatch::Disabled) => "none".to_owned(),
            None => unknown(),
        },
        Kind::Extended => match ExtendedMatch::from_raw(raw) {
            Some(ExtendedMatch::Range) => range(),
            Some(ExtendedMatch::Two) => two(),
            Some(ExtendedMatch::Masked) => masked(),
            Some(ExtendedMatch::RangeUnmasked) => format!("{}, without global mask", range()),
            None => unknown(),
        },
    }
}

fn decode_action(filter: &RawFilter) -> Option<FilterAction> {
    FilterAction::from_raw(u8::try_from(filter.action).ok()?, filter.id2)
}

fn action_text(filter: &RawFilter) -> String {
    match decode_action(filter) {
        Some(FilterAction::Disabled) => "disabled".to_owned(),
        Some(FilterAction::Fifo0) => "RX FIFO0".to_owned(),
        Some(FilterAction::Fifo1) => "RX FIFO1".to_owned(),
        Some(FilterAction::Reject) => "rejected".to_owned(),
        Some(FilterAction::Priority) => "priority mark".to_owned(),
        Some(FilterAction::PriorityFifo0) => "RX FIFO0, priority mark".to_owned(),
        Some(FilterAction::PriorityFifo1) => "RX FIFO1, priority mark".to_owned(),
        Some(FilterAction::RxBuffer(buffer)) => format!("RX buffer {buffer}"),
        None => format!("unknown action {}", filter.action),
    }
}

fn non_match_text(raw: u32) -> &'static str {
    match u8::try_from(raw).ok().and_then(NonMatch::from_raw) {
        Some(NonMatch::Fifo0) => "RX FIFO0",
        Some(NonMatch::Fifo1) => "RX FIFO1",
        Some(NonMatch::Reject | NonMatch::RejectToo) => "rejected",
        None => "unknown",
    }
}
