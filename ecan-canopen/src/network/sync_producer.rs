//! Due SYNC of a channel, and its counter (CiA 301, 7.2.5).

use super::config::SyncConfig;

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

    pub(super) fn sent(&mut self, config: &SyncConfig) {
        self.is_due = false;
        self.is_sent = true;
        if let Some(counter) = self.counter(config) {
            self.counter = counter;
        }
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
                producer.sent(&config);
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
            producer.sent(&config);
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
                producer.sent(&config);
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
        producer.sent(&config);
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
}
