/// Number of bars; odd, so that symmetric distributions have a middle bar.
pub const BARS: usize = 61;

/// Range of the horizontal axis, in microseconds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HistogramRange {
    /// Lower end.
    pub low_us: f64,
    /// Upper end.
    pub high_us: f64,
}

impl HistogramRange {
    /// Range of these times in nanoseconds and of the nominal one in microseconds, with a margin;
    /// `None` without a time.
    pub fn around<'a>(
        times_ns: impl IntoIterator<Item = &'a u64>,
        nominal_us: f64,
    ) -> Option<Self> {
        let (mut low, mut high, mut has_time) = (nominal_us, nominal_us, false);
        for ns in times_ns {
            let us = *ns as f64 / 1e3;
            (low, high, has_time) = (low.min(us), high.max(us), true);
        }
        // Keeps a bar of equal times narrow.
        let margin = ((high - low) * 0.04).max(0.5);
        has_time.then_some(Self { low_us: low - margin, high_us: high + margin })
    }
}

/// Counts of times in equal intervals of a range.
#[derive(Debug, Clone, PartialEq)]
pub struct Histogram {
    /// Range of the intervals.
    pub range: HistogramRange,
    /// Times per interval.
    pub counts: Vec<u64>,
}

impl Histogram {
    /// Counts times in nanoseconds; those outside the range are not counted.
    pub fn new(times_ns: &[u64], range: HistogramRange) -> Self {
        let mut counts = vec![0; BARS];
        let step = (range.high_us - range.low_us) / BARS as f64;
        for ns in times_ns {
            let number = (*ns as f64 / 1e3 - range.low_us) / step;
            if number >= 0.0
                && let Some(count) = counts.get_mut(number as usize)
            {
                *count += 1;
            }
        }
        Self { range, counts }
    }

    /// Largest count.
    pub fn largest(&self) -> u64 {
        self.counts.iter().copied().max().unwrap_or(0)
    }

    /// Width of an interval, in microseconds.
    pub fn step_us(&self) -> f64 {
        (self.range.high_us - self.range.low_us) / self.counts.len().max(1) as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_time_in_the_range_is_counted() {
        let times: Vec<u64> = (0..1_000).map(|nth| 900_000 + nth * 200).collect();
        let range = HistogramRange::around(&times, 1_000.0).unwrap();
        assert!(range.low_us < 900.0 && range.high_us > 1_099.8);
        let histogram = Histogram::new(&times, range);
        assert_eq!(histogram.counts.iter().sum::<u64>(), 1_000);
        assert_eq!(HistogramRange::around([].iter(), 1.0), None);
    }
}
