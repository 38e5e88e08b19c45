//! Distribution of a time for Prometheus.

/// Upper bounds of the buckets, in nanoseconds.
pub(crate) const BOUNDS_NS: [u64; 14] = [
    5_000,
    10_000,
    25_000,
    50_000,
    100_000,
    250_000,
    500_000,
    1_000_000,
    2_500_000,
    5_000_000,
    10_000_000,
    25_000_000,
    50_000_000,
    100_000_000,
];

/// Number of samples up to each bound, with their sum.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(crate) struct TimeHistogram {
    /// Samples in each bucket alone.
    counts: [u64; BOUNDS_NS.len()],
    pub(crate) samples: u64,
    pub(crate) sum_ns: u64,
}

impl TimeHistogram {
    pub(crate) fn record(&mut self, time_ns: u64) {
        let bucket = BOUNDS_NS.partition_point(|bound| *bound < time_ns);
        if let Some(count) = self.counts.get_mut(bucket) {
            *count += 1;
        }
        self.samples += 1;
        self.sum_ns = self.sum_ns.saturating_add(time_ns);
    }

    /// Bounds in nanoseconds, with the samples that are not above them.
    pub(crate) fn cumulative(&self) -> impl Iterator<Item = (u64, u64)> {
        BOUNDS_NS.into_iter().zip(self.counts).scan(0, |total, (bound, count)| {
            *total += count;
            Some((bound, *total))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bound_belongs_to_its_bucket() {
        let mut histogram = TimeHistogram::default();
        for time_ns in [5_000, 5_001, 100_000_000, 100_000_001] {
            histogram.record(time_ns);
        }
        let counts: Vec<_> = histogram.cumulative().map(|(_, count)| count).collect();
        assert_eq!(counts, [1, 2, 2, 2, 2, 2, 2, 2, 2, 2, 2, 2, 2, 3]);
        assert_eq!((histogram.samples, histogram.sum_ns), (4, 200_010_002));
    }
}
