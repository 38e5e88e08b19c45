//! The engine of random trials: each seed decides a trial, which runs on any processor and is summed up with the others.

use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Mutex;
use std::time::{Duration, Instant};

/// Time between two lines of progress.
const PROGRESS: Duration = Duration::from_secs(20);

/// What the trials of a run add up to.
pub trait Sums<O>: Send {
    /// Adds the outcome of a seed.
    fn add(&mut self, seed: u64, outcome: O);

    /// Returns the line of progress after these seconds.
    fn progress(&self, seconds: f64) -> String;
}

/// Runs the trial of each seed, on all processors if `threads` is `None`, until no seed is left or `is_over`. Prints a line of
/// progress from time to time.
///
/// # Panics
/// A trial panics that does not use [`catch_panic`].
pub fn run_seeds<O, S: Sums<O>>(
    seeds: impl Iterator<Item = u64> + Send,
    threads: Option<usize>,
    is_over: impl Fn() -> bool + Sync,
    trial: impl Fn(u64) -> O + Sync,
    sums: S,
    print: impl Fn(&str) + Sync,
) -> S {
    let processors = || std::thread::available_parallelism().map_or(1, usize::from);
    let begin = Instant::now();
    let seeds = Mutex::new(seeds);
    let state = Mutex::new((sums, begin));
    std::thread::scope(|scope| {
        for _ in 0..threads.unwrap_or_else(processors).max(1) {
            scope.spawn(|| {
                while !is_over() {
                    let Some(seed) = seeds.lock().unwrap().next() else { return };
                    let outcome = trial(seed);
                    let (sums, reported) = &mut *state.lock().unwrap();
                    sums.add(seed, outcome);
                    if reported.elapsed() > PROGRESS {
                        *reported = Instant::now();
                        print(&sums.progress(begin.elapsed().as_secs_f64()));
                    }
                }
            });
        }
    });
    state.into_inner().unwrap().0
}

/// Runs a trial.
///
/// # Errors
/// The message of its panic.
pub fn catch_panic<T>(trial: impl FnOnce() -> T) -> Result<T, String> {
    catch_unwind(AssertUnwindSafe(trial)).map_err(|cause| message(&*cause))
}

fn message(cause: &(dyn Any + Send)) -> String {
    let text = cause.downcast_ref::<&str>().map(|text| (*text).to_owned());
    text.or_else(|| cause.downcast_ref::<String>().cloned()).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use super::*;

    #[derive(Default)]
    struct Outcomes(BTreeMap<u64, Result<u64, String>>);

    impl Sums<Result<u64, String>> for Outcomes {
        fn add(&mut self, seed: u64, outcome: Result<u64, String>) {
            assert_eq!(self.0.insert(seed, outcome), None, "seed {seed} ran twice");
        }

        fn progress(&self, _: f64) -> String {
            String::new()
        }
    }

    #[test]
    fn each_seed_runs_once_and_a_panic_is_an_outcome() {
        let trial = |seed| {
            catch_panic(|| {
                assert!(seed != 7, "seed {seed} fails");
                seed * 2
            })
        };
        let outcomes = run_seeds(0..100, Some(4), || false, trial, Outcomes::default(), |_| ());
        assert_eq!(outcomes.0.len(), 100);
        assert_eq!(outcomes.0[&7], Err("seed 7 fails".to_owned()));
        assert_eq!(outcomes.0[&8], Ok(16));
    }

    #[test]
    fn no_seed_begins_after_the_end() {
        let outcomes = run_seeds(0.., None, || true, Ok, Outcomes::default(), |_| ());
        assert!(outcomes.0.is_empty());
    }
}
