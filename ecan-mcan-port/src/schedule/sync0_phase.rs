//! Phase of the running cycle in the Sync0 period (manual 13.8).

use ecan_host::{AdapterConfig, ClockSource};

/// Calculates the application time since the first cycle: the library keeps Sync0 in phase with the
/// first application time.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Sync0Phase {
    /// Deadline of the last cycle, and its time since the first one.
    last: Option<(u64, u64)>,
}

impl Sync0Phase {
    /// Begin of a cycle with this deadline; returns the application time since the first one, in
    /// nanoseconds.
    pub(crate) fn begin(&mut self, time_ns: u64, adapter: &AdapterConfig) -> u64 {
        let cycle_ns = u64::from(adapter.cycle_ns().max(1));
        let follows = adapter.dc.is_some_and(|dc| dc.source == ClockSource::Reference);
        let since_first_ns = match self.last {
            None => 0,
            Some((last_ns, since_first_ns)) => {
                let passed_ns = time_ns.saturating_sub(last_ns);
                // Shifted deadlines: the number of cycles counts, not their length.
                let whole_ns = (passed_ns + cycle_ns / 2) / cycle_ns * cycle_ns;
                since_first_ns + if follows { whole_ns } else { passed_ns }
            }
        };
        self.last = Some((time_ns, since_first_ns));
        since_first_ns
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use ecan_host::DcSync;

    use super::*;

    #[test]
    fn cycles_are_counted_from_the_first_one_also_on_a_shifted_grid() {
        let mut adapter = AdapterConfig::new(1).with_cycle(Duration::from_millis(1));
        adapter.dc = Some(DcSync::new(Duration::from_millis(4), Duration::ZERO));
        for source in [ClockSource::Host, ClockSource::Reference] {
            adapter.dc = adapter.dc.map(|dc| DcSync { source, ..dc });
            let mut phase = Sync0Phase::default();
            let mut begin = |time_ns| phase.begin(time_ns, &adapter);
            assert_eq!([700, 1_000_700, 4_000_700].map(&mut begin), [0, 1_000_000, 4_000_000]);
            let shifted = [5_000_500, 6_000_300].map(&mut begin);
            assert_eq!(
                shifted,
                match source {
                    ClockSource::Host => [4_999_800, 5_999_600],
                    ClockSource::Reference => [5_000_000, 6_000_000],
                }
            );
        }
    }
}
