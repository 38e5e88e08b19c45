//! End of a live view (`--watch`) by `--count` and `--timeout`.

use clap::Args;

use crate::context::{Failure, Result};
use crate::frames::Service;

/// Options that end a live view. The command has the option `--watch`.
#[derive(Clone, Copy, Debug, Args)]
pub struct LiveViewArguments {
    /// With --watch: exit after this number of lines, at least 1
    #[arg(short = 'n', long, value_name = "COUNT", requires = "watch",
          value_parser = clap::value_parser!(u64).range(1..))]
    count: Option<u64>,
    /// With --watch: exit if nothing is received for this time, in ms
    #[arg(short = 'T', long, value_name = "MS", requires = "watch")]
    timeout: Option<u64>,
}

impl LiveViewArguments {
    /// Returns whether the view ends without the user.
    pub fn has_end(&self) -> bool {
        self.count.is_some() || self.timeout.is_some()
    }

    /// Starts the view now.
    pub fn start(&self, service: &Service) -> LiveView {
        self.start_at(service.now_ns(), service.response_ns())
    }

    fn start_at(&self, start_ns: u64, last_ns: u64) -> LiveView {
        let timeout_ns = self.timeout.map(|ms| ms.saturating_mul(1_000_000));
        LiveView { count: self.count, timeout_ns, start_ns, last_ns, printed: 0 }
    }
}

/// A live view: time and number of its lines.
#[derive(Clone, Copy, Debug)]
pub struct LiveView {
    /// Number of lines that is expected.
    pub count: Option<u64>,
    timeout_ns: Option<u64>,
    start_ns: u64,
    /// Observed time of the last reception.
    last_ns: u64,
    /// Number of lines so far.
    pub printed: u64,
}

impl LiveView {
    /// Time since the start, in seconds.
    pub fn seconds(&self, time_ns: u64) -> f64 {
        time_ns.saturating_sub(self.start_ns) as f64 / 1e9
    }

    /// Restarts the timeout.
    pub fn receive(&mut self, observed_ns: u64) {
        self.last_ns = observed_ns;
    }

    /// Counts a line; returns whether it is the last one.
    pub fn count_line(&mut self) -> bool {
        self.printed += 1;
        Some(self.printed) == self.count
    }

    /// Returns whether nothing was received for the timeout.
    pub fn has_timed_out(&self, observed_ns: u64) -> bool {
        self.timeout_ns.is_some_and(|limit| observed_ns.saturating_sub(self.last_ns) >= limit)
    }

    /// Observed time after a cycle; `None` if the user ended the view, which is its usual end without a count.
    ///
    /// # Errors
    /// Those of the cycle.
    pub fn after_cycle(&self, cycle: Result<u64>) -> Result<Option<u64>> {
        match cycle {
            Err(Failure::Incomplete(_)) if self.count.is_none() => Ok(None),
            cycle => cycle.map(Some),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: u64 = 1_000_000;

    fn view(count: Option<u64>, timeout: Option<u64>) -> LiveView {
        LiveViewArguments { count, timeout }.start_at(50 * MS, 50 * MS)
    }

    #[test]
    fn view_ends_with_its_count_or_timeout() {
        let mut view = view(Some(2), Some(10));
        assert!(!view.count_line() && view.count_line() && !view.count_line());
        assert!(!view.has_timed_out(59 * MS) && view.has_timed_out(60 * MS));
        view.receive(55 * MS);
        assert!(!view.has_timed_out(64 * MS) && view.has_timed_out(65 * MS));
        assert_eq!(view.seconds(1_550 * MS), 1.5);
    }

    #[test]
    fn user_ends_a_view_without_count() {
        let stopped = || Err(Failure::Incomplete("stopped".to_owned()));
        assert!(matches!(view(None, None).after_cycle(stopped()), Ok(None)));
        assert!(matches!(view(Some(1), None).after_cycle(stopped()), Err(Failure::Incomplete(_))));
        assert!(matches!(view(None, None).after_cycle(Ok(7)), Ok(Some(7))));
        assert!(!view(None, None).has_timed_out(u64::MAX));
    }
}
