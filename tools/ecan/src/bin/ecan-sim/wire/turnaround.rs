use std::fmt;
use std::time::SystemTime;

use hdrhistogram::Histogram;

/// Maximum recorded time, ns: a minute.
const LONGEST_NS: u64 = 60_000_000_000;

/// The system's real-time clock in nanoseconds, which also gives arrival times.
pub fn real_time_ns() -> u64 {
    let now = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default();
    u64::try_from(now.as_nanos()).unwrap_or(u64::MAX)
}

#[derive(Debug, Clone)]
pub struct Turnaround {
    total: Histogram<u64>,
    computing: Histogram<u64>,
}

impl Turnaround {
    pub fn new() -> Self {
        // infallible: the bounds are in order, and 3 digits are supported
        let histogram = || Histogram::new_with_bounds(1, LONGEST_NS, 3).expect("valid bounds");
        Self { total: histogram(), computing: histogram() }
    }

    /// Counts a frame taken at `taken_ns` and sent back at `sent_ns`, both by the clock of the
    /// arrival time.
    pub fn count(&mut self, arrived_ns: Option<u64>, taken_ns: u64, sent_ns: u64) {
        let since = |from: u64| sent_ns.saturating_sub(from).max(1);
        self.total.saturating_record(since(arrived_ns.unwrap_or(taken_ns)));
        self.computing.saturating_record(since(taken_ns));
    }
}

impl fmt::Display for Turnaround {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.total.is_empty() {
            return write!(f, "turnaround: no frame answered");
        }
        let us = |ns: u64| ns as f64 / 1000.0;
        let figures = |histogram: &Histogram<u64>| {
            let at = |quantile| us(histogram.value_at_quantile(quantile));
            (at(0.5), at(0.99), us(histogram.max()))
        };
        let (median, p99, max) = figures(&self.total);
        writeln!(
            f,
            "turnaround: median {median:.1} us, p99 {p99:.1} us, max {max:.1} us, from the arrival \
             at the interface to the answer"
        )?;
        let (median, p99, max) = figures(&self.computing);
        write!(
            f,
            "  of which in the program: median {median:.1} us, p99 {p99:.1} us, max {max:.1} us"
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn turnaround_is_measured_from_arrival_and_from_program() {
        let mut turnaround = Turnaround::new();
        assert_eq!(turnaround.to_string(), "turnaround: no frame answered");
        turnaround.count(Some(10_000), 14_000, 16_000);
        turnaround.count(None, 14_000, 16_000);
        turnaround.count(Some(20_000), 14_000, 16_000);
        let printed = turnaround.to_string();
        assert!(
            printed.starts_with("turnaround: median 2.0 us, p99 6.0 us, max 6.0 us"),
            "{printed}"
        );
        assert!(printed.ends_with("median 2.0 us, p99 2.0 us, max 2.0 us"), "{printed}");
    }
}
