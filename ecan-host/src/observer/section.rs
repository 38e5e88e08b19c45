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
    pub(super) const ALL: [Self; Self::COUNT] = [Self::Adapter, Self::Port, Self::Axes];
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

    /// Initial words of a section.
    pub(super) fn words_of(&self, section: Section) -> &[u64] {
        self.initial.get(self.range(section)).unwrap_or_default()
    }

    /// Initial words of a section, without its number.
    pub(super) fn initial_of(&self, section: Section) -> &[u64] {
        self.words_of(section).get(1..).unwrap_or_default()
    }

    /// The layout with other initial words of one section.
    pub(super) fn with(&self, section: Section, initial: &[u64]) -> Self {
        let mut words = Vec::new();
        let sections = Section::ALL.map(|it| {
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
            WordGroup(to).write(words);
            self.rest = rest;
        }
    }

    /// Takes the next `count` groups of `N` words; `None` if the section has fewer. Real-time safe.
    #[inline(always)]
    pub fn groups<const N: usize>(&mut self, count: usize) -> Option<WordGroups<'a, N>> {
        let (groups, rest) = self.rest.split_at_checked(count * N)?;
        self.rest = rest;
        Some(WordGroups(groups.as_chunks().0))
    }

    /// Leaves the next words as they are. Real-time safe.
    #[inline(always)]
    pub fn skip(&mut self, count: usize) {
        self.rest = self.rest.get(count..).unwrap_or_default();
    }
}

/// Groups of words of a section, one per item. For the layers of the SDK.
#[derive(Debug, Clone, Copy)]
pub struct WordGroups<'a, const N: usize>(&'a [[AtomicU64; N]]);

impl<'a, const N: usize> WordGroups<'a, N> {
    /// All groups.
    #[inline(always)]
    pub fn iter(&self) -> impl Iterator<Item = WordGroup<'a, N>> + use<'a, N> {
        self.0.iter().map(WordGroup)
    }

    /// One group; `None` for an index out of range.
    pub fn get(&self, nth: usize) -> Option<WordGroup<'a, N>> {
        self.0.get(nth).map(WordGroup)
    }
}

/// Words of a section that are written together. For the layers of the SDK.
#[derive(Debug, Clone, Copy)]
pub struct WordGroup<'a, const N: usize>(&'a [AtomicU64; N]);

impl<'a, const N: usize> WordGroup<'a, N> {
    /// The words from `START` on; it does not compile unless the group has them.
    #[inline(always)]
    pub fn part<const START: usize, const COUNT: usize>(self) -> WordGroup<'a, COUNT> {
        const { assert!(START + COUNT <= N) };
        // infallible: checked above, so that the cycle checks nothing
        WordGroup(self.0[START..].first_chunk().unwrap())
    }

    /// The words in groups of `M`, without a rest that is smaller.
    #[inline(always)]
    pub fn groups<const M: usize>(self) -> WordGroups<'a, M> {
        WordGroups(self.0.as_chunks().0)
    }

    /// Writes all words. Real-time safe.
    #[inline(always)]
    pub fn write(self, words: [u64; N]) {
        // Not by iterators, which are not unrolled.
        let mut nth = 0;
        while nth < N {
            self.0[nth].store(words[nth], Ordering::Relaxed);
            nth += 1;
        }
    }

    /// Returns whether this version has these words from an earlier time. Real-time safe.
    #[inline(always)]
    pub fn has(self, words: [u64; N]) -> bool {
        self.0.iter().zip(words).all(|(word, other)| word.load(Ordering::Relaxed) == other)
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
