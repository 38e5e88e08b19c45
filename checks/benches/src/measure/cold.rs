//! Measures with nothing in the caches.

use std::hint::black_box;

use crate::measure::turns::{Outcome, interleaved, rounds, timed};

/// Rounds of a cold measure; each walks the buffer twice.
const COLD_ROUNDS: usize = 301;
const LINE: usize = 64;
/// Default if the kernel reports no cache.
const SECOND_LEVEL: usize = 1024 * 1024;
const LAST_LEVEL: usize = 32 * 1024 * 1024;

/// Evicts previously used data from the caches, up to a level.
#[derive(Debug)]
pub struct Evictor {
    buffer: Vec<u8>,
}

impl Evictor {
    /// Out of all caches: with a buffer twice as large as the last-level cache.
    #[must_use]
    pub fn of_last_level() -> Self {
        Self::of(cache_bytes().max().unwrap_or(LAST_LEVEL))
    }

    /// Out of the processor's own caches, if possible into the last-level one: with a
    /// buffer twice as large as the second-level cache.
    #[must_use]
    pub fn of_second_level() -> Self {
        let mut sizes: Vec<_> = cache_bytes().collect();
        sizes.sort_unstable();
        // Two of the first level, one of the second, one of the last.
        sizes.pop();
        Self::of(sizes.pop().unwrap_or(SECOND_LEVEL))
    }

    fn of(cache: usize) -> Self {
        Self { buffer: vec![1; 2 * cache] }
    }

    /// Bytes of the buffer.
    #[must_use]
    pub fn bytes(&self) -> usize {
        self.buffer.len()
    }

    /// Reads a byte of every cache line of the buffer.
    fn walk(&self) {
        let sum: u64 = self.buffer.iter().step_by(LINE).map(|&byte| u64::from(byte)).sum();
        black_box(sum);
    }

    /// Both sides in turn, each after a walk.
    pub fn cold(&self, first: impl FnMut(), second: impl FnMut()) -> Outcome {
        let (mut first, mut second) = (timed(first), timed(second));
        let after_a_walk = |side: &mut dyn FnMut() -> f64| {
            self.walk();
            side()
        };
        interleaved(rounds(COLD_ROUNDS), || after_a_walk(&mut first), || after_a_walk(&mut second))
    }
}

/// Sizes of the caches that the kernel reports.
fn cache_bytes() -> impl Iterator<Item = usize> {
    (0..8).filter_map(|index| {
        let path = format!("/sys/devices/system/cpu/cpu0/cache/index{index}/size");
        let text = std::fs::read_to_string(path).ok()?;
        let kibibytes: usize = text.trim().strip_suffix('K')?.parse().ok()?;
        Some(kibibytes * 1024)
    })
}
