//! Measures with nothing in the caches.

use std::hint::black_box;

use crate::turns::{Outcome, interleaved, rounds, timed};

/// Rounds of a cold measure; each walks the buffer twice.
const COLD_ROUNDS: usize = 301;
const LINE: usize = 64;

/// Drives everything else out of the caches.
#[derive(Debug)]
pub struct Evictor {
    buffer: Vec<u8>,
}

impl Evictor {
    /// With a buffer twice as large as the last-level cache.
    #[expect(clippy::new_without_default, reason = "it asks the machine")]
    #[must_use]
    pub fn new() -> Self {
        Self { buffer: vec![1; 2 * last_level_cache()] }
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

/// Bytes of the largest cache that the kernel tells of, or 32 MiB where it tells of none.
fn last_level_cache() -> usize {
    let sizes = (0..8).filter_map(|index| {
        let path = format!("/sys/devices/system/cpu/cpu0/cache/index{index}/size");
        let text = std::fs::read_to_string(path).ok()?;
        let kibibytes: usize = text.trim().strip_suffix('K')?.parse().ok()?;
        Some(kibibytes * 1024)
    });
    sizes.max().unwrap_or(32 * 1024 * 1024)
}
