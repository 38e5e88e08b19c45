//! A set of numbers that only grows.

#[derive(Clone, Debug, Default)]
pub struct Seen {
    words: Vec<u64>,
    count: u64,
    next: u32,
}

impl Seen {
    /// Adds a number; false if it is there already.
    pub fn insert(&mut self, number: u32) -> bool {
        let (word, bit) = ((number / 64) as usize, 1 << (number % 64));
        if word >= self.words.len() {
            self.words.resize(word + 1, 0);
        }
        let is_new = self.words[word] & bit == 0;
        self.words[word] |= bit;
        self.count += u64::from(is_new);
        self.next = self.next.max(number + 1);
        is_new
    }

    pub fn contains(&self, number: u32) -> bool {
        self.words.get((number / 64) as usize).is_some_and(|word| word & 1 << (number % 64) != 0)
    }

    pub fn count(&self) -> u64 {
        self.count
    }

    /// One more than the largest number.
    pub fn next(&self) -> u32 {
        self.next
    }
}
