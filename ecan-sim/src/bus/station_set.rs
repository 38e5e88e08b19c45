//! Sets of stations.

const WORD_BITS: usize = u64::BITS as usize;

/// A set of stations by their numbers.
#[derive(Clone, Debug, Default)]
pub(crate) struct StationSet {
    words: Vec<u64>,
}

impl StationSet {
    /// Makes room, so that inserting the station does not allocate.
    pub(crate) fn reserve(&mut self, station: usize) {
        let words = station / WORD_BITS + 1;
        self.words.resize(words.max(self.words.len()), 0);
    }

    pub(crate) fn insert(&mut self, station: usize) {
        self.reserve(station);
        if let Some(bits) = self.words.get_mut(station / WORD_BITS) {
            *bits |= 1 << (station % WORD_BITS);
        }
    }

    pub(crate) fn remove(&mut self, station: usize) {
        if let Some(bits) = self.words.get_mut(station / WORD_BITS) {
            *bits &= !(1 << (station % WORD_BITS));
        }
    }

    /// The first station with this number or a higher one.
    pub(crate) fn first_from(&self, station: usize) -> Option<usize> {
        let first = station / WORD_BITS;
        let bits = *self.words.get(first)? & (u64::MAX << (station % WORD_BITS));
        if bits != 0 {
            return Some(first * WORD_BITS + bits.trailing_zeros() as usize);
        }
        let further = self.words.iter().enumerate().skip(first + 1).find(|(_, bits)| **bits != 0);
        further.map(|(word, bits)| word * WORD_BITS + bits.trailing_zeros() as usize)
    }

    /// The stations in ascending order.
    pub(crate) fn iter(&self) -> Iter<'_> {
        Iter { words: self.words.iter(), bits: 0, base: 0, next_base: 0 }
    }
}

/// Iterator over the stations of a [`StationSet`].
pub(crate) struct Iter<'a> {
    words: std::slice::Iter<'a, u64>,
    /// Stations of the present word that are still to come.
    bits: u64,
    base: usize,
    next_base: usize,
}

impl Iterator for Iter<'_> {
    type Item = usize;

    #[inline]
    fn next(&mut self) -> Option<usize> {
        while self.bits == 0 {
            self.bits = *self.words.next()?;
            self.base = self.next_base;
            self.next_base += WORD_BITS;
        }
        let station = self.base + self.bits.trailing_zeros() as usize;
        self.bits &= self.bits - 1;
        Some(station)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stations_come_in_ascending_order() {
        let mut set = StationSet::default();
        assert_eq!(set.iter().next(), None);
        [130, 3, 64, 0, 63, 3].into_iter().for_each(|station| set.insert(station));
        assert_eq!(set.iter().collect::<Vec<_>>(), [0, 3, 63, 64, 130]);
        let first_from = [0, 1, 4, 64, 65, 130, 131, 500].map(|from| set.first_from(from));
        let expected = [0, 3, 63, 64, 130, 130].map(Some);
        assert_eq!(first_from, [&expected[..], &[None, None]].concat()[..]);
        [64, 3, 500].into_iter().for_each(|station| set.remove(station));
        assert_eq!(set.iter().collect::<Vec<_>>(), [0, 63, 130]);
    }
}
