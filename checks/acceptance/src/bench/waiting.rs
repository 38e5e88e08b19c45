//! Time limits and pauses.

use std::time::{Duration, Instant};

use super::Bench;
use crate::stop::Stop;

impl Bench {
    /// A time limit of this machine.
    pub fn limit(&self, time: Duration) -> Duration {
        time * self.arguments.patience
    }

    /// Waits, unless the user interrupts.
    pub fn pause(&self, time: Duration) -> Result<(), Stop> {
        let begin = Instant::now();
        while begin.elapsed() < time {
            if self.interrupt.is_set() {
                return Err(Stop::Interrupted);
            }
            std::thread::sleep(Duration::from_millis(20).min(time));
        }
        Ok(())
    }

    /// Repeats a question until it has an answer.
    pub fn poll<T>(
        &mut self,
        what: &str,
        limit: Duration,
        mut ask: impl FnMut(&mut Self) -> Result<Option<T>, Stop>,
    ) -> Result<T, Stop> {
        let (begin, limit) = (Instant::now(), self.limit(limit));
        loop {
            if let Some(answer) = ask(self)? {
                return Ok(answer);
            }
            if begin.elapsed() >= limit {
                return Err(Stop::Failed(format!("not within {} s: {what}", limit.as_secs())));
            }
            self.pause(Duration::from_millis(100))?;
        }
    }

    /// Random time up to this one, from the seed.
    pub fn random_time(&mut self, most: Duration) -> Duration {
        // xorshift64
        self.random ^= self.random << 13;
        self.random ^= self.random >> 7;
        self.random ^= self.random << 17;
        most.mul_f64((self.random >> 11) as f64 / (1_u64 << 53) as f64)
    }
}
