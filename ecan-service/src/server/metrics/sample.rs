//! Samples of what metrics show: the cycle, its times, the clients and the objects of the gateways.

use std::collections::BTreeMap;

use ecan_cia402::AxisStatus;
use ecan_host::{AdapterConfig, DomainReport};
use ecan_mcan_port::{SessionState, SlaveStatistics};
use ecan_protocol::image::ChannelStatus;
use ecan_protocol::mapping::CHANNELS;

use crate::protocol::{BusState, CycleState, Hello, ServiceStats};

#[derive(Debug)]
pub(crate) struct CycleSample {
    pub(crate) state: CycleState,
    pub(crate) run_time: TimeHistogram,
    pub(crate) late: TimeHistogram,
    pub(crate) slaves: Vec<SlaveSample>,
    pub(crate) axes: Vec<AxisStatus>,
}

#[derive(Debug)]
pub(crate) struct SlaveSample {
    pub(crate) session: SessionState,
    pub(crate) report: DomainReport,
    pub(crate) statistics: SlaveStatistics,
    /// Of the enabled channels.
    pub(crate) channels: [Option<ChannelStatus>; CHANNELS],
}

/// Values by slave, channel, index of channel 0 and subindex.
pub(crate) type ObjectValues = BTreeMap<(usize, u8, u16, u8), u32>;

#[derive(Debug)]
pub(crate) struct MetricsSample {
    pub(crate) hello: Hello,
    /// Without the list of clients.
    pub(crate) stats: ServiceStats,
    /// Connected clients.
    pub(crate) clients: usize,
    /// `None` without a cycle.
    pub(crate) cycle: Option<CycleSample>,
    /// `None` if the master did not answer.
    pub(crate) bus: Option<BusState>,
    /// Configuration of the slaves of the cycle.
    pub(crate) adapter: Option<AdapterConfig>,
    /// Objects of the gateways that were read.
    pub(crate) objects: ObjectValues,
}

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
