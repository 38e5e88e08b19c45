//! Two sides timed in turn.

use std::hint::black_box;
use std::time::Instant;

/// Rounds of a warm measure.
const WARM_ROUNDS: usize = 3001;
const WARM_UP: usize = 100;
/// Rounds of a cold one; each walks the buffer twice.
const COLD_ROUNDS: usize = 301;
const LINE: usize = 64;

/// Medians of both sides, in nanoseconds per round.
#[derive(Clone, Copy)]
pub struct Medians {
    pub rust: f64,
    pub c: f64,
}

impl Medians {
    pub fn ratio(self) -> f64 {
        self.rust / self.c
    }
}

fn median(times: &mut [f64]) -> f64 {
    times.sort_by(f64::total_cmp);
    times[times.len() / 2]
}

fn time(run: &mut impl FnMut()) -> f64 {
    let start = Instant::now();
    run();
    start.elapsed().as_nanos() as f64
}

fn interleaved(
    rounds: usize,
    mut before: impl FnMut(),
    mut rust: impl FnMut(),
    mut c: impl FnMut(),
) -> Medians {
    let (mut rust_times, mut c_times) = (Vec::new(), Vec::new());
    for round in 0..rounds {
        // Neither side always follows the other.
        for turn in 0..2 {
            before();
            if (round + turn) % 2 == 0 {
                rust_times.push(time(&mut rust));
            } else {
                c_times.push(time(&mut c));
            }
        }
    }
    Medians { rust: median(&mut rust_times), c: median(&mut c_times) }
}

/// Both sides in turn, caches warm.
pub fn warm(mut rust: impl FnMut(), mut c: impl FnMut()) -> Medians {
    for _ in 0..WARM_UP {
        rust();
        c();
    }
    interleaved(WARM_ROUNDS, || (), rust, c)
}

/// One side alone, caches warm: nanoseconds per round.
pub fn warm_alone(mut run: impl FnMut()) -> f64 {
    for _ in 0..WARM_UP {
        run();
    }
    let mut times: Vec<_> = (0..WARM_ROUNDS).map(|_| time(&mut run)).collect();
    median(&mut times)
}

/// Drives everything else out of the caches.
pub struct Evictor {
    buffer: Vec<u8>,
}

impl Evictor {
    /// With a buffer twice as large as the last-level cache.
    pub fn new() -> Self {
        Self { buffer: vec![1; 2 * last_level_cache()] }
    }

    pub fn bytes(&self) -> usize {
        self.buffer.len()
    }

    /// Reads a byte of every cache line of the buffer.
    fn walk(&self) {
        let sum: u64 = self.buffer.iter().step_by(LINE).map(|&byte| u64::from(byte)).sum();
        black_box(sum);
    }

    /// Both sides in turn, each after a walk.
    pub fn cold(&self, rust: impl FnMut(), c: impl FnMut()) -> Medians {
        interleaved(COLD_ROUNDS, || self.walk(), rust, c)
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
