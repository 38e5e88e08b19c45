//! The axes of a snapshot.
//!
//! The section has the words that do not change of all axes, then those of each cycle of all axes, then
//! those of rejected targets.

use ecan_canopen::Network;
use ecan_host::{Adapter, Section, SectionWriter, Snapshot};

use super::axis_words::{
    AXIS_WORDS, AxisWords, CYCLE_WORDS, FIXED_WORDS, REJECTION_WORDS, fixed_words, status_of,
    write_cycle,
};
use crate::axis::axis::Axis;
use crate::axis::config::AxisConfig;
use crate::axis::status::AxisStatus;

pub(crate) fn reserve<'a>(adapter: &Adapter, axes: impl Iterator<Item = &'a AxisConfig>) {
    let mut words: Vec<u64> = axes.flat_map(fixed_words).collect();
    words.resize(words.len() / FIXED_WORDS * AXIS_WORDS, 0);
    adapter.reserve_section(Section::Axes, &words);
}

/// Writes the axes' section of a cycle, one axis after the other.
pub(crate) struct AxesWriter<'a> {
    cycle: SectionWriter<'a>,
    rejections: SectionWriter<'a>,
}

impl<'a> AxesWriter<'a> {
    /// `None` if nothing is observed.
    pub(crate) fn new(adapter: &'a Adapter, is_observed: bool, axis_count: usize) -> Option<Self> {
        let mut rest = adapter.section_writer(Section::Axes).filter(|_| is_observed)?;
        rest.skip(axis_count * FIXED_WORDS);
        let cycle = rest.split(axis_count * CYCLE_WORDS);
        Some(Self { cycle, rejections: rest })
    }

    /// Writes the next axis, whose phase was updated in this cycle.
    #[inline(always)]
    pub(crate) fn write(&mut self, axis: &Axis, network: &Network, now_ns: u64) {
        write_cycle(axis, network, now_ns, &mut self.cycle, &mut self.rejections);
    }
}

/// The axes in a [`Snapshot`]: those of the [`Cia402`](crate::Cia402) that was created last.
#[derive(Debug, Clone, Copy)]
pub struct AxesSnapshot<'a> {
    fixed: &'a [[u64; FIXED_WORDS]],
    cycle: &'a [[u64; CYCLE_WORDS]],
    rejections: &'a [[u64; REJECTION_WORDS]],
}

impl<'a> AxesSnapshot<'a> {
    /// The axes' part of a snapshot; `None` if the cycle did not send targets
    /// ([`Cia402::send_targets_all`](crate::Cia402::send_targets_all)).
    pub fn of(snapshot: &'a Snapshot) -> Option<Self> {
        let words = snapshot.section(Section::Axes)?;
        let count = words.len() / AXIS_WORDS;
        let (fixed, rest) = words.split_at_checked(count * FIXED_WORDS)?;
        let (cycle, rejections) = rest.split_at_checked(count * CYCLE_WORDS)?;
        Some(Self {
            fixed: fixed.as_chunks().0,
            cycle: cycle.as_chunks().0,
            rejections: rejections.as_chunks().0,
        })
    }

    /// Number of axes.
    pub fn axis_count(&self) -> usize {
        self.fixed.len()
    }

    /// Status of an axis at the end of the cycle; `None` for an index out of range.
    pub fn axis(&self, axis: usize) -> Option<AxisStatus> {
        status_of(AxisWords {
            fixed: self.fixed.get(axis)?,
            cycle: self.cycle.get(axis)?,
            rejection: self.rejections.get(axis)?,
        })
    }

    /// Status of all axes.
    pub fn axes(&self) -> impl Iterator<Item = AxisStatus> {
        (0..self.axis_count()).filter_map(|axis| self.axis(axis))
    }
}
