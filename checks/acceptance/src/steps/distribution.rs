//! Times of a series, as figures of the report.

use std::time::Duration;

use crate::bench::Bench;

/// Upper limits of the classes of the histogram, in s.
const CLASSES: [f64; 7] = [0.5, 1.0, 2.0, 5.0, 10.0, 30.0, 60.0];

/// Times of a series.
#[derive(Debug, Default)]
pub struct Distribution(Vec<f64>);

impl Distribution {
    pub fn add(&mut self, time: Duration) {
        self.0.push(time.as_secs_f64());
    }

    /// The time that this share of the series does not exceed.
    fn quantile(sorted: &[f64], share: f64) -> Option<f64> {
        let rank = (sorted.len() as f64 * share).ceil() as usize;
        sorted.get(rank.max(1) - 1).copied()
    }

    /// Records number, smallest, median, 90 % and largest, and how many lie below each class limit.
    pub fn report(mut self, bench: &mut Bench, name: &str) {
        self.0.sort_by(f64::total_cmp);
        bench.figure(format!("{name}_count"), self.0.len() as f64);
        for (label, share) in [("min", 0.0), ("p50", 0.5), ("p90", 0.9), ("max", 1.0)] {
            if let Some(value) = Self::quantile(&self.0, share) {
                bench.figure(format!("{name}_{label}_s"), value);
            }
        }
        for class in CLASSES {
            let count = self.0.iter().filter(|time| **time <= class).count();
            bench.figure(format!("{name}_within_{class:04.1}_s"), count as f64);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_values_of_the_series() {
        let sorted: Vec<f64> = (1..=10).map(f64::from).collect();
        let quantiles = [0.0, 0.5, 0.9, 1.0].map(|share| Distribution::quantile(&sorted, share));
        assert_eq!(quantiles, [Some(1.0), Some(5.0), Some(9.0), Some(10.0)]);
        assert_eq!(Distribution::quantile(&[], 0.5), None);
    }
}
