//! Messages that the host produces: due time and counter of SYNC, contents of TIME (CiA 301, 7.2.5 and 7.2.6).

use std::time::{Duration, SystemTime, UNIX_EPOCH};

use super::config::SyncConfig;
use crate::TimeOfDay;

#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct SyncProducer {
    is_enabled: bool,
    cycles_left: u32,
    /// A SYNC period begins in this cycle.
    is_planned: bool,
    is_due: bool,
    /// One was sent in this cycle.
    is_sent: bool,
    counter: u8,
}

impl SyncProducer {
    /// Enables or disables the channel. The counter restarts at 1, and the first SYNC is due in the
    /// next cycle.
    pub(super) fn enable(&mut self, is_enabled: bool) {
        *self = Self { is_enabled, ..Self::default() };
    }

    /// One cycle. A SYNC that found no space stays due; missed ones are not repeated.
    pub(super) fn tick(&mut self, config: &SyncConfig) {
        self.is_sent = false;
        self.is_planned = false;
        if !self.is_enabled {
            return;
        }
        if self.cycles_left == 0 {
            self.is_planned = true;
            self.is_due = true;
            self.cycles_left = config.every_cycles.max(1);
        }
        self.cycles_left -= 1;
    }

    pub(super) fn is_planned(&self) -> bool {
        self.is_planned
    }

    pub(super) fn is_due(&self) -> bool {
        self.is_due
    }

    pub(super) fn is_sent(&self) -> bool {
        self.is_sent
    }

    /// The counter that the next SYNC carries.
    pub(super) fn counter(&self, config: &SyncConfig) -> Option<u8> {
        config.counter_overflow.map(
            |overflow| {
                if self.counter >= overflow { 1 } else { self.counter + 1 }
            },
        )
    }

    pub(super) fn on_sent(&mut self, config: &SyncConfig) {
        self.is_due = false;
        self.is_sent = true;
        if let Some(counter) = self.counter(config) {
            self.counter = counter;
        }
    }
}

/// Unix time at an instant of the bus clock.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct TimeReference {
    /// Unix time in nanoseconds.
    pub unix_ns: u64,
    /// Time of the bus clock in nanoseconds, [`Adapter::clock`](ecan_host::Adapter::clock).
    pub bus_ns: u64,
}

impl TimeReference {
    /// Reads the system clock at the time `bus_ns` of the bus clock. Makes a system call: call it outside the
    /// cycle.
    pub fn from_system_clock(bus_ns: u64) -> Self {
        let unix = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        Self { unix_ns: nanoseconds(unix), bus_ns }
    }

    /// Unix time in nanoseconds at a time of the bus clock.
    pub const fn unix_ns_at(&self, bus_ns: u64) -> u64 {
        let since = bus_ns.saturating_sub(self.bus_ns);
        let before = self.bus_ns.saturating_sub(bus_ns);
        self.unix_ns.saturating_add(since).saturating_sub(before)
    }
}

/// Production of TIME on every channel that has a node. Nodes that consume it have bit 31 in 0x1012.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct TimeConfig {
    /// Time between two messages; at least 1 ms.
    pub period: Duration,
    /// Relation of the bus clock to Unix time. The bus clock continues it, so the cycle makes no system call; set it
    /// again to follow adjustments of the system clock.
    pub reference: TimeReference,
}

impl TimeConfig {
    /// Returns whether TIME can hold the reference.
    pub(super) fn is_valid(&self) -> bool {
        TimeOfDay::from_unix_ns(self.reference.unix_ns).is_some()
    }

    /// The message at a time of the bus clock; `None` beyond the range of TIME.
    pub(super) fn message(&self, now_ns: u64) -> Option<[u8; 6]> {
        TimeOfDay::from_unix_ns(self.reference.unix_ns_at(now_ns)).map(TimeOfDay::to_bytes)
    }
}

/// Duration in nanoseconds, at most `u64::MAX`.
pub(super) fn nanoseconds(duration: Duration) -> u64 {
    u64::try_from(duration.as_nanos()).unwrap_or(u64::MAX)
}

/// Due time of a periodic message; the first one is due at once.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct PeriodTimer {
    due_ns: Option<u64>,
}

impl PeriodTimer {
    pub(super) fn is_due(&self, now_ns: u64) -> bool {
        self.due_ns.is_none_or(|due| now_ns >= due)
    }

    /// Keeps the period, of at least 1 ms; after a gap it restarts instead of catching up.
    pub(super) fn advance(&mut self, now_ns: u64, period: Duration) {
        let period = nanoseconds(period.max(Duration::from_millis(1)));
        let next = self.due_ns.map_or(now_ns, |due| due.saturating_add(period));
        self.due_ns = Some(if next > now_ns { next } else { now_ns.saturating_add(period) });
    }

    pub(super) fn reset(&mut self) {
        self.due_ns = None;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn enabled() -> SyncProducer {
        let mut producer = SyncProducer::default();
        producer.enable(true);
        producer
    }

    #[test]
    fn counter_runs_from_1_to_its_overflow() {
        let config = SyncConfig { counter_overflow: Some(3), ..SyncConfig::default() };
        let mut producer = enabled();
        let counters: Vec<_> = (0..7)
            .map(|_| {
                producer.tick(&config);
                let counter = producer.counter(&config).unwrap();
                producer.on_sent(&config);
                counter
            })
            .collect();
        assert_eq!(counters, [1, 2, 3, 1, 2, 3, 1]);
    }

    #[test]
    fn largest_overflow_restarts_the_counter_after_240() {
        let config = SyncConfig { counter_overflow: Some(240), ..SyncConfig::default() };
        let mut producer = enabled();
        for expected in (1..=240).cycle().take(500) {
            producer.tick(&config);
            assert_eq!(producer.counter(&config), Some(expected));
            producer.on_sent(&config);
        }
    }

    #[test]
    fn sync_is_due_every_third_cycle() {
        let config = SyncConfig { every_cycles: 3, ..SyncConfig::default() };
        let mut producer = enabled();
        let due: Vec<_> = (0..7)
            .map(|_| {
                producer.tick(&config);
                let due = producer.is_due();
                producer.on_sent(&config);
                due
            })
            .collect();
        assert_eq!(due, [true, false, false, true, false, false, true]);
    }

    #[test]
    fn rejected_sync_is_sent_once_and_late() {
        let config = SyncConfig { every_cycles: 2, counter_overflow: Some(5), schedule: None };
        let mut producer = enabled();
        let planned: Vec<_> = (0..3)
            .map(|_| {
                producer.tick(&config);
                assert!(producer.is_due());
                producer.is_planned()
            })
            .collect();
        assert_eq!(planned, [true, false, true]);
        assert_eq!(producer.counter(&config), Some(1));
        producer.on_sent(&config);
        producer.tick(&config);
        assert!(!producer.is_due(), "the plan of even cycles holds");
        producer.tick(&config);
        assert!(producer.is_due());
        assert_eq!(producer.counter(&config), Some(2));
    }

    #[test]
    fn disabled_channel_is_never_due() {
        let mut producer = SyncProducer::default();
        producer.tick(&SyncConfig::default());
        assert!(!producer.is_due());
    }

    #[test]
    fn reference_is_continued_by_the_bus_clock() {
        let reference = TimeReference { unix_ns: 1_000, bus_ns: 50 };
        assert_eq!(reference.unix_ns_at(50), 1_000);
        assert_eq!(reference.unix_ns_at(70), 1_020);
        assert_eq!(reference.unix_ns_at(20), 970);
    }

    #[test]
    fn time_before_1984_is_rejected() {
        let period = Duration::from_secs(1);
        let with = |unix_ns| {
            TimeConfig { period, reference: TimeReference { unix_ns, bus_ns: 0 } }.is_valid()
        };
        assert!(!with(0));
        assert!(with(TimeReference::from_system_clock(0).unix_ns));
    }

    const MS: u64 = 1_000_000;

    #[test]
    fn timer_keeps_its_period_without_catching_up() {
        let period = Duration::from_millis(10);
        let mut timer = PeriodTimer::default();
        assert!(timer.is_due(0));
        timer.advance(3 * MS, period);
        assert!(!timer.is_due(12 * MS));
        assert!(timer.is_due(13 * MS));
        timer.advance(14 * MS, period);
        assert!(timer.is_due(23 * MS), "a late cycle does not shift the plan");
        timer.advance(100 * MS, period);
        assert!(!timer.is_due(109 * MS));
        assert!(timer.is_due(110 * MS));
    }
}
