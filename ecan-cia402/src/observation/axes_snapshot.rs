//! The axes of a snapshot.

use ecan_canopen::Network;
use ecan_host::{Adapter, Section, Snapshot};

use super::axis_words::{
    AXIS_WORDS, FIXED_WORDS, REJECTION_WORDS, cycle_words, fixed_words, status_of,
};
use crate::axis::axis::Axis;
use crate::axis::config::AxisConfig;
use crate::axis::status::AxisStatus;

pub(crate) fn reserve<'a>(adapter: &Adapter, axes: impl Iterator<Item = &'a AxisConfig>) {
    let mut words = Vec::new();
    for axis in axes {
        words.extend(fixed_words(axis));
        words.resize(words.len() + AXIS_WORDS - FIXED_WORDS, 0);
    }
    adapter.reserve_section(Section::Axes, &words);
}

/// Writes the axes' section of this cycle.
pub(crate) fn publish(adapter: &Adapter, axes: &[Axis], network: &Network, now_ns: u64) {
    let Some(mut writer) = adapter.section_writer(Section::Axes) else { return };
    for axis in axes {
        let (words, rejected) = cycle_words(axis, network, now_ns);
        writer.skip(FIXED_WORDS);
        writer.write(words);
        match rejected {
            Some(words) => writer.write(words),
            None => writer.skip(REJECTION_WORDS),
        }
    }
}

/// The axes in a [`Snapshot`]: those of the [`Cia402`](crate::Cia402) that was created last.
#[derive(Debug, Clone, Copy)]
pub struct AxesSnapshot<'a> {
    axes: &'a [[u64; AXIS_WORDS]],
}

impl<'a> AxesSnapshot<'a> {
    /// The axes' part of a snapshot; `None` if the cycle did not send targets
    /// ([`Cia402::send_targets_all`](crate::Cia402::send_targets_all)).
    pub fn of(snapshot: &'a Snapshot) -> Option<Self> {
        Some(Self { axes: snapshot.section(Section::Axes)?.as_chunks().0 })
    }

    /// Number of axes.
    pub fn axis_count(&self) -> usize {
        self.axes.len()
    }

    /// Status of an axis at the end of the cycle; `None` for an index out of range.
    pub fn axis(&self, axis: usize) -> Option<AxisStatus> {
        status_of(self.axes.get(axis)?)
    }

    /// Status of all axes.
    pub fn axes(&self) -> impl Iterator<Item = AxisStatus> {
        self.axes.iter().filter_map(status_of)
    }
}
