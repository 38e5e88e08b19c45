//! A filter as the user describes it.

use clap::{ArgGroup, Args, ValueEnum};
use ecan_protocol::config::{
    ExtendedFilter, ExtendedMatch, FilterAction, FilterElementFault, McanChannelConfig,
    StandardFilter, StandardMatch,
};

use crate::value::parse_unsigned;

use super::channel_filters::{ElementCounts, Kind, RawFilter};

/// The options of a new filter.
#[derive(Debug, Args)]
#[command(group = ArgGroup::new("identifiers").required(true).args(["id", "range", "mask"]))]
pub(super) struct NewFilter {
    /// For 29-bit identifiers
    #[arg(long)]
    extended: bool,
    /// One identifier or two
    #[arg(long, num_args = 1..=2, value_name = "ID", value_parser = parse_identifier)]
    id: Vec<u32>,
    /// From the first identifier to the last
    #[arg(long, num_args = 2, value_names = ["FIRST", "LAST"], value_parser = parse_identifier)]
    range: Vec<u32>,
    /// Identifiers that equal this one in the bits of the mask
    #[arg(long, num_args = 2, value_names = ["ID", "MASK"], value_parser = parse_identifier)]
    mask: Vec<u32>,
    /// The range counts without the global mask 0x8001:40
    #[arg(long, requires = "range", requires = "extended")]
    unmasked: bool,
    /// What happens to the frames
    #[arg(long, value_enum, default_value_t = To::Fifo0, value_name = "WHERE")]
    to: To,
    /// Into this receive buffer; only with one --id
    #[arg(long, value_name = "N", conflicts_with_all = ["to", "range", "mask"])]
    buffer: Option<u8>,
    /// Mark the frames as sync messages for the timestamp unit
    #[arg(long)]
    sync: bool,
}

/// Where a frame goes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum To {
    Fifo0,
    Fifo1,
    Reject,
    Priority,
    PriorityFifo0,
    PriorityFifo1,
}

fn parse_identifier(text: &str) -> Result<u32, String> {
    let value = parse_unsigned(text).ok_or_else(|| format!("\"{text}\" is no identifier"))?;
    u32::try_from(value).map_err(|_| format!("{text} is above 0x1FFFFFFF"))
}

/// A filter in the types of the library.
#[derive(Clone, Copy, Debug)]
pub(super) enum Filter {
    Standard(StandardFilter),
    Extended(ExtendedFilter),
}

impl NewFilter {
    fn action(&self) -> FilterAction {
        match (self.buffer, self.to) {
            (Some(buffer), _) => FilterAction::RxBuffer(buffer),
            (None, To::Fifo0) => FilterAction::Fifo0,
            (None, To::Fifo1) => FilterAction::Fifo1,
            (None, To::Reject) => FilterAction::Reject,
            (None, To::Priority) => FilterAction::Priority,
            (None, To::PriorityFifo0) => FilterAction::PriorityFifo0,
            (None, To::PriorityFifo1) => FilterAction::PriorityFifo1,
        }
    }

    /// The filter; identifiers that do not fit their kind are told by [`Filter::check`], but for
    /// those that the type cannot hold.
    pub(super) fn build(&self) -> Result<Filter, String> {
        let (matching, ids) = match (&self.id[..], &self.range[..], &self.mask[..]) {
            ([one], _, _) => (ExtendedMatch::Two, [*one, *one]),
            ([one, two], _, _) => (ExtendedMatch::Two, [*one, *two]),
            (_, [first, last], _) if self.unmasked => {
                (ExtendedMatch::RangeUnmasked, [*first, *last])
            }
            (_, [first, last], _) => (ExtendedMatch::Range, [*first, *last]),
            (_, _, [id, mask]) => (ExtendedMatch::Masked, [*id, *mask]),
            _ => return Err("give --id, --range or --mask".to_owned()),
        };
        let (action, sync) = (self.action(), self.sync);
        if self.buffer.is_some() && self.id.len() > 1 {
            return Err("a receive buffer takes one --id".to_owned());
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
                format!("0x{id:X} is above 0x7FF; 29-bit identifiers need --extended")
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

    /// Whether identifiers, FIFOs and buffers are there.
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
            Self::Standard(it) => {
                (it.matching.raw(), it.action, it.sync, it.id1.into(), it.id2.into())
            }
            Self::Extended(it) => (it.matching.raw(), it.action, it.sync, it.id1, it.id2),
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
