const WORD_BITS: usize = 64;
const WORDS: usize = (1 << 11) / WORD_BITS;

/// A set of standard CAN IDs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct StandardIds {
    words: [u64; WORDS],
}

impl StandardIds {
    /// Every standard CAN ID.
    pub(crate) const fn all() -> Self {
        Self { words: [u64::MAX; WORDS] }
    }

    /// Adds an ID; another number than that of a standard ID has no effect.
    pub(crate) fn insert(&mut self, raw: usize) {
        if let Some(bits) = self.words.get_mut(raw / WORD_BITS) {
            *bits |= 1 << (raw % WORD_BITS);
        }
    }

    pub(crate) fn contains(&self, raw: usize) -> bool {
        self.words.get(raw / WORD_BITS).is_some_and(|bits| bits >> (raw % WORD_BITS) & 1 == 1)
    }

    pub(crate) fn iter(&self) -> impl Iterator<Item = usize> {
        self.differences(&Self::default())
    }

    /// The IDs that only one of the sets contains.
    pub(crate) fn differences(&self, other: &Self) -> impl Iterator<Item = usize> + use<> {
        let words = self.words.into_iter().zip(other.words).enumerate();
        words.filter(|(_, (own, other))| own != other).flat_map(|(word, (own, other))| {
            let differs = own ^ other;
            (0..WORD_BITS)
                .filter(move |bit| differs >> bit & 1 == 1)
                .map(move |bit| word * WORD_BITS + bit)
        })
    }
}
