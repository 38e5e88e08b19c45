//! Sections of a snapshot: each layer has one and encodes it.

use std::ops::Range;
use std::sync::atomic::{AtomicU64, Ordering};

/// Part of a snapshot that one layer writes. For the layers of the SDK.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Section {
    /// Cycle and working counters.
    Adapter,
    /// Gateways and channels.
    Port,
    /// CiA 402 axes.
    Axes,
}

impl Section {
    pub(super) const COUNT: usize = 3;
}

/// Place of the sections in the words of a version. The first word of a section is the number of the
/// version in which it was written last.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(super) struct Layout {
    sections: [Range<usize>; Section::COUNT],
    /// Initial words of all versions.
    pub(super) initial: Box<[u64]>,
}

impl Layout {
    pub(super) fn range(&self, section: Section) -> Range<usize> {
        self.sections.get(section as usize).cloned().unwrap_or_default()
    }

    /// Initial words of a section, without its number.
    pub(super) fn initial_of(&self, section: Section) -> &[u64] {
        let words = self.initial.get(self.range(section)).unwrap_or_default();
        words.get(1..).unwrap_or_default()
    }

    /// The layout with other initial words of one section.
    pub(super) fn with(&self, section: Section, initial: &[u64]) -> Self {
        let mut words = Vec::new();
        let sections = [Section::Adapter, Section::Port, Section::Axes].map(|it| {
            let content = if it == section { initial } else { self.initial_of(it) };
            let start = words.len();
            words.push(0);
            words.extend_from_slice(content);
            start..words.len()
        });
        Self { sections, initial: words.into() }
    }
}

/// Writes the words of a section, in order. For the layers of the SDK.
#[derive(Debug)]
pub struct SectionWriter<'a> {
    rest: &'a [AtomicU64],
}

impl<'a> SectionWriter<'a> {
    pub(super) fn new(rest: &'a [AtomicU64]) -> Self {
        Self { rest }
    }

    /// Writes the next words; words beyond the end of the section are dropped. Real-time safe.
    #[inline(always)]
    pub fn write<const N: usize>(&mut self, words: [u64; N]) {
        if let Some((to, rest)) = self.rest.split_first_chunk::<N>() {
            // Not by iterators, which are not unrolled.
            let mut nth = 0;
            while nth < N {
                to[nth].store(words[nth], Ordering::Relaxed);
                nth += 1;
            }
            self.rest = rest;
        }
    }

    /// Takes the next words apart; fewer at the end of the section. Real-time safe.
    #[inline(always)]
    pub fn split(&mut self, count: usize) -> Self {
        let (first, rest) = self.rest.split_at(count.min(self.rest.len()));
        self.rest = rest;
        Self { rest: first }
    }

    /// Returns whether this version has this word next, from an earlier time. Real-time safe.
    #[inline(always)]
    pub fn has_next(&self, word: u64) -> bool {
        self.rest.first().is_some_and(|next| next.load(Ordering::Relaxed) == word)
    }

    /// Leaves the next words as they are. Real-time safe.
    #[inline(always)]
    pub fn skip(&mut self, count: usize) {
        self.rest = self.rest.get(count..).unwrap_or_default();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn layout_keeps_the_other_sections() {
        let first = Layout::default().with(Section::Adapter, &[1, 2]);
        let both = first.with(Section::Axes, &[7]).with(Section::Adapter, &[3, 4, 5]);
        assert_eq!(both.initial_of(Section::Adapter), [3, 4, 5]);
        assert_eq!(both.initial_of(Section::Axes), [7]);
        assert!(both.initial_of(Section::Port).is_empty());
        assert_eq!(both.range(Section::Axes).end, both.initial.len());
    }

    #[test]
    fn writer_stays_within_its_section() {
        let words = [const { AtomicU64::new(0) }; 3];
        let mut writer = SectionWriter::new(&words);
        writer.write([1, 2]);
        writer.write([3, 4]);
        writer.write([5]);
        writer.skip(4);
        writer.write([6]);
        assert_eq!(words.map(AtomicU64::into_inner), [1, 2, 5]);
    }
}
