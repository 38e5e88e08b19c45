//! The axes of a snapshot.
//!
//! The section has the time, the words that do not change of all axes, then those of each cycle of all
//! axes, then those of rejected targets, then those of further objects of process data.

use ecan_canopen::Network;
use ecan_host::{Adapter, Section, Snapshot, WordGroups};

use super::axis_status::{
    AXIS_WORDS, AxisStatus, AxisWords, CYCLE_WORDS, EXTENSION_WORDS, FIXED_WORDS, REJECTION_WORDS,
    encode_any, encode_extension, encode_running, fixed_words, status_of,
};
use crate::axis::axis::Axis;
use crate::axis::config::AxisConfig;

/// Words of the time of the cycle.
const TIME_WORDS: usize = 1;

pub(crate) fn reserve<'a>(adapter: &Adapter, axes: impl Iterator<Item = &'a AxisConfig>) {
    let fixed: Vec<u64> = axes.flat_map(fixed_words).collect();
    let mut words = vec![0; TIME_WORDS];
    words.extend_from_slice(&fixed);
    words.resize(TIME_WORDS + fixed.len() / FIXED_WORDS * AXIS_WORDS, 0);
    adapter.publisher().reserve(Section::Axes, &words);
}

/// Writes the axes' section of a cycle.
pub(crate) struct AxesWriter<'a> {
    now_ns: u64,
    cycle: WordGroups<'a, CYCLE_WORDS>,
    rejections: WordGroups<'a, REJECTION_WORDS>,
    extensions: WordGroups<'a, EXTENSION_WORDS>,
}

impl<'a> AxesWriter<'a> {
    /// `None` if nothing is observed.
    pub(crate) fn new(
        adapter: &'a Adapter,
        is_observed: bool,
        now_ns: u64,
        axis_count: usize,
    ) -> Option<Self> {
        // The writer marks the section as written.
        let mut rest = is_observed.then(|| adapter.publisher().section(Section::Axes)).flatten()?;
        rest.write([now_ns]);
        rest.skip(axis_count * FIXED_WORDS);
        let cycle = rest.groups(axis_count)?;
        let rejections = rest.groups(axis_count)?;
        Some(Self { now_ns, cycle, rejections, extensions: rest.groups(axis_count)? })
    }

    /// Updates the phases and writes the axes.
    pub(crate) fn update(self, axes: &mut [Axis], network: &Network) {
        let now_ns = self.now_ns;
        for (axis, to) in axes.iter_mut().zip(self.cycle.iter()) {
            // Phase and words in one pass, since the checks are the same.
            let target = axis.update_phase(now_ns);
            if axis.plan.is_extended
                && let Some(to) = self.extensions.get(axis.plan.index)
            {
                to.write(encode_extension(axis));
            }
            if let Some(words) = target.and_then(|target| encode_running(axis, target, network)) {
                to.write(words);
                continue;
            }
            let (words, rejection) = encode_any(axis, network, now_ns);
            to.write(words);
            if let Some((to, words)) = self.rejections.get(axis.plan.index).zip(rejection) {
                to.write(words);
            }
        }
    }
}

/// The axes in a [`Snapshot`]: those of the [`Cia402`](crate::Cia402) that was created last, and none
/// after its end.
#[derive(Debug, Clone, Copy)]
pub struct AxesSnapshot<'a> {
    now_ns: u64,
    fixed: &'a [[u64; FIXED_WORDS]],
    cycle: &'a [[u64; CYCLE_WORDS]],
    rejections: &'a [[u64; REJECTION_WORDS]],
    extensions: &'a [[u64; EXTENSION_WORDS]],
}

impl<'a> AxesSnapshot<'a> {
    /// The axes' part of a snapshot; `None` if the cycle did not send targets
    /// ([`Cia402::send_targets_all`](crate::Cia402::send_targets_all)).
    pub fn of(snapshot: &'a Snapshot) -> Option<Self> {
        let (now_ns, words) = snapshot.section(Section::Axes)?.split_first()?;
        let count = words.len() / AXIS_WORDS;
        let (fixed, rest) = words.split_at_checked(count * FIXED_WORDS)?;
        let (cycle, rest) = rest.split_at_checked(count * CYCLE_WORDS)?;
        let (rejections, extensions) = rest.split_at_checked(count * REJECTION_WORDS)?;
        Some(Self {
            now_ns: *now_ns,
            fixed: fixed.as_chunks().0,
            cycle: cycle.as_chunks().0,
            rejections: rejections.as_chunks().0,
            extensions: extensions.as_chunks().0,
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
            extension: self.extensions.get(axis)?,
            now_ns: self.now_ns,
        })
    }

    /// Status of all axes.
    pub fn axes(&self) -> impl Iterator<Item = AxisStatus> {
        (0..self.axis_count()).filter_map(|axis| self.axis(axis))
    }
}
