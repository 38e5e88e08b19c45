//! Two sides timed in turn.

use std::time::Instant;

/// Rounds of a warm measure.
const WARM_ROUNDS: usize = 3001;
const WARM_UP: usize = 100;

/// Medians of two sides, in nanoseconds per round, and of the rounds' ratios.
#[derive(Clone, Copy, Debug)]
pub struct Outcome {
    /// Of the side given first.
    pub first: f64,
    /// Of the other.
    pub second: f64,
    /// The first over the second.
    pub ratio: f64,
}

/// The middle one of `values`; NaN where there are none.
#[must_use]
pub fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
}

/// So many rounds under `cargo bench`; a few, to show that it works, where the program runs
/// otherwise.
#[must_use]
pub fn rounds(full: usize) -> usize {
    let is_bench = std::env::args().any(|argument| argument == "--bench");
    if is_bench { full } else { full.min(3) }
}

/// A side whose whole call is timed, in nanoseconds.
pub fn timed(mut run: impl FnMut()) -> impl FnMut() -> f64 {
    move || {
        let start = Instant::now();
        run();
        start.elapsed().as_nanos() as f64
    }
}

/// Both sides in turn; each call gives its own time in nanoseconds.
pub fn interleaved(
    rounds: usize,
    mut first: impl FnMut() -> f64,
    mut second: impl FnMut() -> f64,
) -> Outcome {
    let (mut firsts, mut seconds, mut ratios) = (Vec::new(), Vec::new(), Vec::new());
    for round in 0..rounds {
        // Neither side always follows the other.
        let (one, other) = if round % 2 == 0 {
            let one = first();
            (one, second())
        } else {
            let other = second();
            (first(), other)
        };
        firsts.push(one);
        seconds.push(other);
        ratios.push(one / other);
    }
    Outcome { first: median(firsts), second: median(seconds), ratio: median(ratios) }
}

/// Both sides in turn, caches warm.
pub fn warm(first: impl FnMut(), second: impl FnMut()) -> Outcome {
    let (mut first, mut second) = (timed(first), timed(second));
    interleaved(rounds(WARM_UP), &mut first, &mut second);
    interleaved(rounds(WARM_ROUNDS), first, second)
}

/// One side alone, caches warm: nanoseconds per round.
pub fn warm_alone(run: impl FnMut()) -> f64 {
    let mut run = timed(run);
    for _ in 0..rounds(WARM_UP) {
        run();
    }
    median((0..rounds(WARM_ROUNDS)).map(|_| run()).collect())
}

#[cfg(test)]
mod tests {
    use super::{interleaved, median};

    #[test]
    fn median_is_the_middle_value() {
        assert_eq!(median(vec![3.0, 1.0, 2.0]), 2.0);
        assert!(median(vec![]).is_nan());
    }

    #[test]
    fn one_disturbed_round_does_not_change_the_ratio() {
        let mut round = 0;
        let disturbed = || {
            round += 1;
            if round == 2 { 1000.0 } else { 2.0 }
        };
        let outcome = interleaved(5, disturbed, || 4.0);
        assert_eq!((outcome.first, outcome.second, outcome.ratio), (2.0, 4.0, 0.5));
    }
}
