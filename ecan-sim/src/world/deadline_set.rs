//! Times of several participants, and the earliest.

use crate::world::NEVER;

/// Times by index, with the cached minimum, which is read at every instant.
#[derive(Clone, Debug)]
pub(super) struct DeadlineSet {
    times: Vec<u64>,
    first: u64,
    /// Number of times that are equal to `first`. Drives are due together: the minimum is searched
    /// once for all of them.
    at_first: usize,
}

impl Default for DeadlineSet {
    fn default() -> Self {
        Self { times: Vec::new(), first: NEVER, at_first: 0 }
    }
}

impl DeadlineSet {
    pub(super) fn add(&mut self) {
        self.times.push(NEVER);
        self.at_first += usize::from(self.first == NEVER);
    }

    pub(super) fn get(&self, number: usize) -> u64 {
        self.times.get(number).copied().unwrap_or(NEVER)
    }

    pub(super) const fn first(&self) -> u64 {
        self.first
    }

    pub(super) fn set(&mut self, number: usize, time: u64) {
        let Some(slot) = self.times.get_mut(number) else { return };
        let before = std::mem::replace(slot, time);
        if time < self.first {
            (self.first, self.at_first) = (time, 1);
            return;
        }
        self.at_first += usize::from(time == self.first);
        self.at_first -= usize::from(before == self.first);
        if self.at_first == 0 {
            self.first = self.times.iter().copied().min().unwrap_or(NEVER);
            self.at_first = self.times.iter().filter(|time| **time == self.first).count();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn first_is_updated_by_every_change() {
        let mut due = DeadlineSet::default();
        assert_eq!(due.first(), NEVER);
        (0..3).for_each(|_| due.add());
        let mut set = |number, time| {
            due.set(number, time);
            due.first()
        };
        assert_eq!([set(0, 30), set(1, 20), set(2, 40)], [30, 20, 20]);
        assert_eq!([set(1, 50), set(0, NEVER), set(2, 40)], [30, 40, 40]);
        assert_eq!([set(1, 40), set(2, 60), set(1, NEVER)], [40, 40, 60]);
        assert_eq!(set(9, 1), 60, "unknown index");
        assert_eq!((due.get(2), due.get(9)), (60, NEVER));
    }
}
