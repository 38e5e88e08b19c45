//! Versions of the snapshot in a ring, with one section per layer: one writer, which never waits, and
//! any number of readers.

#[cfg(not(loom))]
use std::hint::spin_loop;
use std::ops::Range;
use std::sync::atomic::Ordering;
#[cfg(not(loom))]
use std::sync::atomic::{AtomicU64, fence};
use std::sync::{Arc, OnceLock};

#[cfg(loom)]
use loom::{
    hint::spin_loop,
    sync::atomic::{AtomicU64, fence},
};

/// Versions of the ring. A reader repeats its read only if the writer publishes one less than this
/// while it copies.
const VERSIONS: usize = if cfg!(loom) { 2 } else { 4 };

/// Words of one snapshot, with the number of the publication; 0 while it is being written.
#[derive(Debug)]
struct Version {
    number: AtomicU64,
    /// In the order of the layout. Apart, so that the writer needs no range of all words.
    sections: [Box<[AtomicU64]>; Section::COUNT],
}

/// Ring of versions with one layout.
///
/// Each version has a sequence lock: the writer sets its number to 0, writes the words, and sets the
/// new number. Two fences order the words between them, so that a reader which finds the same number
/// before and after its copy has the words of that number.
///
/// A larger ring is [appended](Self::append) outside the cycle; the writer continues there with its
/// next version, and readers follow.
#[derive(Debug)]
pub(super) struct Ring {
    layout: Layout,
    versions: [Version; VERSIONS],
    /// Number of the last complete version; 0 before the first.
    newest: AtomicU64,
    next: OnceLock<Arc<Ring>>,
}

impl Ring {
    pub(super) fn new(layout: Layout) -> Self {
        let atomic = |word: &u64| AtomicU64::new(*word);
        let version = |_| Version {
            number: AtomicU64::new(0),
            sections: Section::ALL
                .map(|section| layout.words_of(section).iter().map(atomic).collect()),
        };
        Self {
            versions: std::array::from_fn(version),
            layout,
            newest: AtomicU64::new(0),
            next: OnceLock::new(),
        }
    }

    pub(super) fn layout(&self) -> &Layout {
        &self.layout
    }

    pub(super) fn next(&self) -> Option<&Arc<Self>> {
        self.next.get()
    }

    /// Appends a ring; the first one stays. Allocates.
    pub(super) fn append(&self, layout: Layout) {
        let _ = self.next.set(Arc::new(Self::new(layout)));
    }

    pub(super) fn has_version(&self) -> bool {
        self.newest.load(Ordering::Acquire) != 0
    }

    /// The last ring of the chain.
    pub(super) fn last(self: &Arc<Self>) -> &Arc<Self> {
        let mut ring = self;
        while let Some(next) = ring.next() {
            ring = next;
        }
        ring
    }

    /// The last ring of the chain that has a version; this one if none has.
    pub(super) fn last_written(self: &Arc<Self>) -> &Arc<Self> {
        let (mut ring, mut found) = (self, self);
        while let Some(next) = ring.next() {
            ring = next;
            if ring.has_version() {
                found = ring;
            }
        }
        found
    }

    #[inline]
    fn version(&self, number: u64) -> &Version {
        // infallible: the remainder is an index
        &self.versions[number as usize % VERSIONS]
    }

    /// Begins the version `number`, from 1 on, each larger than the one before. Only the writer calls it.
    pub(super) fn begin(&self, number: u64) {
        self.version(number).number.store(0, Ordering::Relaxed);
        // A reader that sees one of the following words also sees the 0.
        fence(Ordering::Release);
    }

    /// The words of a section, the first for the number, of the version that was begun.
    #[inline]
    pub(super) fn section(&self, number: u64, section: Section) -> &[AtomicU64] {
        let [adapter, port, axes] = &self.version(number).sections;
        match section {
            Section::Adapter => adapter,
            Section::Port => port,
            Section::Axes => axes,
        }
    }

    /// Completes the version that was begun.
    pub(super) fn complete(&self, number: u64) {
        self.version(number).number.store(number, Ordering::Release);
        self.newest.store(number, Ordering::Release);
    }

    /// Copies the newest version and returns its number; `None` before the first. `words` has the
    /// length of the layout.
    pub(super) fn read(&self, words: &mut [u64]) -> Option<u64> {
        loop {
            let number = self.newest.load(Ordering::Acquire);
            if number == 0 {
                return None;
            }
            let version = self.version(number);
            if version.number.load(Ordering::Acquire) == number {
                for (to, word) in words.iter_mut().zip(version.sections.iter().flatten()) {
                    *to = word.load(Ordering::Relaxed);
                }
                // Against the one in `begin`.
                fence(Ordering::Acquire);
                if version.number.load(Ordering::Relaxed) == number {
                    return Some(number);
                }
            }
            spin_loop();
        }
    }
}

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
        let sections = Section::ALL.map(|other| {
            let content = if other == section { initial } else { self.initial_of(other) };
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

#[cfg(all(test, not(loom)))]
mod tests {
    use std::thread;

    use super::*;

    /// Words of a version.
    const WORDS: usize = if cfg!(miri) { 4 } else { 12 };
    /// Reads and publications together.
    const OPERATIONS: u64 = if cfg!(miri) { 400 } else { 10_000_000 };
    const READERS: usize = 3;

    fn ring(words: usize) -> Ring {
        Ring::new(Layout::default().with(Section::Adapter, &vec![0; words]))
    }

    fn publish(ring: &Ring, number: u64) {
        ring.begin(number);
        for (nth, word) in ring.section(number, Section::Adapter).iter().enumerate() {
            word.store(number.wrapping_mul(nth as u64 + 1), Ordering::Relaxed);
        }
        ring.complete(number);
    }

    fn assert_consistent(number: u64, words: &[u64]) {
        for (nth, word) in words.iter().take(WORDS + 1).enumerate() {
            assert_eq!(*word, number.wrapping_mul(nth as u64 + 1), "word {nth} of {number}");
        }
    }

    #[test]
    fn concurrent_reads_are_never_torn() {
        let ring = &ring(WORDS);
        let operations = &AtomicU64::new(0);
        let is_running = || operations.fetch_add(1, Ordering::Relaxed) < OPERATIONS;
        let read = || {
            let mut words = vec![0; ring.layout().initial.len()];
            let mut last = 0;
            while is_running() {
                let Some(number) = ring.read(&mut words) else { continue };
                assert_consistent(number, &words);
                assert!(number >= last, "{number} after {last}");
                last = number;
            }
        };
        thread::scope(|scope| {
            for _ in 0..READERS {
                scope.spawn(read);
            }
            let mut published = 0;
            while is_running() {
                published += 1;
                publish(ring, published);
            }
            assert!(published > 0);
        });
    }

    #[test]
    fn reader_follows_to_the_ring_with_a_version() {
        let first = Arc::new(ring(WORDS));
        let mut words = vec![0; first.layout().initial.len()];
        assert_eq!(first.read(&mut words), None);
        publish(&first, 1);
        first.append(first.layout().with(Section::Port, &[0; 5]));
        first.last().append(first.layout().with(Section::Port, &[0; 9]));
        assert!(Arc::ptr_eq(first.last_written(), &first), "nothing was published there yet");
        let last = first.last();
        publish(last, 2);
        assert!(Arc::ptr_eq(first.last_written(), last));
        let mut more = vec![0; last.layout().initial.len()];
        assert_eq!(last.read(&mut more), Some(2));
        assert_eq!(more.len(), words.len() + 9);
        // The earlier ring still has its last version.
        assert_eq!(first.read(&mut words), Some(1));
        assert_consistent(1, &words);
    }

    #[test]
    fn version_being_written_is_not_read() {
        let ring = ring(WORDS);
        let mut words = vec![0; ring.layout().initial.len()];
        for number in 1..=20 {
            ring.begin(number);
            ring.section(number, Section::Adapter)[1].store(u64::MAX, Ordering::Relaxed);
            let before = ring.read(&mut words);
            assert_eq!(before, (number > 1).then_some(number - 1));
            if let Some(before) = before {
                assert_consistent(before, &words);
            }
            publish(&ring, number);
            assert_eq!(ring.read(&mut words), Some(number));
            assert_consistent(number, &words);
        }
    }

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
