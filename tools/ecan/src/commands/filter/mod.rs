//! `ecan filter`: acceptance filters of a channel through the editing window (manual 13.4).

mod channel_filters;
mod command;
#[cfg(test)]
mod tests;

pub use channel_filters::{ChannelFilters, Kind as FilterKind, RawFilter};
pub use command::{FilterArguments, run};
