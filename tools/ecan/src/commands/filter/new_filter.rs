use clap::builder::{PossibleValuesParser, TypedValueParser};
use clap::{ArgGroup, Args};
use ecan_protocol::config::{
    ExtendedFilter, ExtendedMatch, FilterAction, FilterElementFault, McanChannelConfig,
    StandardFilter, StandardMatch,
};

use crate::value::parse_unsigned;

use super::channel_filters::{ElementCounts, Kind, RawFilter};

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
    PossibleValuesParser::new(actions.map(|(name, _)| name))
        .map(move |name| actions.iter().find(|it| it.0 == name).map_or(actions[0].1, |it| it.1))
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
