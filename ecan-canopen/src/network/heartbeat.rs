//! Heartbeat consumer of one node, and heartbeat producer of the host (CiA 301, 7.2.8.3.2.2).

use std::time::Duration;

use super::config::HostHeartbeat;

pub(super) fn nanoseconds(duration: Duration) -> u64 {
    u64::try_from(duration.as_nanos()).unwrap_or(u64::MAX)
}

ecan_protocol::text_enum! {
    /// State of a node's heartbeat.
    #[derive(Default)]
    pub enum Heartbeat;
    /// Not watched.
    #[default]
    Unconfigured = "not watched";
    /// Watched; none received since the watch began or since the node booted.
    Unknown = "none received yet";
    /// Received in time.
    Active = "active";
    /// Overdue. The next heartbeat makes it active again.
    TimedOut = "timed out";
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct HeartbeatWatch {
    timeout_ns: u64,
    state: Heartbeat,
    deadline_ns: u64,
    timeouts: u32,
}

impl HeartbeatWatch {
    pub(super) fn new(timeout: Duration) -> Self {
        let mut consumer = Self::default();
        consumer.set_timeout(timeout);
        consumer
    }

    /// Watches with another timeout from now on; zero stops watching.
    pub(super) fn set_timeout(&mut self, timeout: Duration) {
        self.timeout_ns = nanoseconds(timeout);
        self.state = if timeout.is_zero() { Heartbeat::Unconfigured } else { Heartbeat::Unknown };
    }

    /// Returns whether the heartbeat was overdue before.
    pub(super) fn received(&mut self, now_ns: u64) -> bool {
        let was_overdue = self.state == Heartbeat::TimedOut;
        if self.timeout_ns > 0 {
            self.state = Heartbeat::Active;
            self.deadline_ns = now_ns.saturating_add(self.timeout_ns);
        }
        was_overdue
    }

    /// The boot-up message is not a heartbeat: the watch begins with the first heartbeat.
    pub(super) fn booted(&mut self) {
        if self.timeout_ns > 0 {
            self.state = Heartbeat::Unknown;
        }
    }

    /// Returns whether the heartbeat became overdue.
    pub(super) fn tick(&mut self, now_ns: u64) -> bool {
        let is_overdue = self.state == Heartbeat::Active && now_ns > self.deadline_ns;
        if is_overdue {
            self.state = Heartbeat::TimedOut;
            self.timeouts = self.timeouts.saturating_add(1);
        }
        is_overdue
    }

    #[inline]
    pub(super) fn state(&self) -> Heartbeat {
        self.state
    }

    #[inline]
    pub(super) fn timeouts(&self) -> u32 {
        self.timeouts
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct HeartbeatTimer {
    due_ns: Option<u64>,
}

impl HeartbeatTimer {
    pub(super) fn is_due(&self, now_ns: u64) -> bool {
        self.due_ns.is_none_or(|due| now_ns >= due)
    }

    /// Keeps the period; after a gap it restarts instead of catching up.
    pub(super) fn sent(&mut self, now_ns: u64, config: &HostHeartbeat) {
        let period = nanoseconds(config.period.max(Duration::from_millis(1)));
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
    use crate::NodeId;

    const MS: u64 = 1_000_000;

    #[test]
    fn watch_begins_with_the_first_heartbeat() {
        let mut consumer = HeartbeatWatch::new(Duration::from_millis(100));
        consumer.tick(1_000 * MS);
        assert_eq!(consumer.state(), Heartbeat::Unknown, "no watch before the first heartbeat");
        consumer.received(1_000 * MS);
        consumer.tick(1_100 * MS);
        assert_eq!(consumer.state(), Heartbeat::Active, "exactly in time");
        consumer.tick(1_100 * MS + 1);
        assert_eq!((consumer.state(), consumer.timeouts()), (Heartbeat::TimedOut, 1));
        consumer.tick(9_000 * MS);
        assert_eq!(consumer.timeouts(), 1, "counted once");
        consumer.received(9_001 * MS);
        assert_eq!(consumer.state(), Heartbeat::Active);
    }

    #[test]
    fn boot_up_message_is_not_a_heartbeat() {
        let mut consumer = HeartbeatWatch::new(Duration::from_millis(100));
        consumer.received(0);
        consumer.booted();
        consumer.tick(500 * MS);
        assert_eq!((consumer.state(), consumer.timeouts()), (Heartbeat::Unknown, 0));
    }

    #[test]
    fn zero_timeout_disables_the_watch() {
        let mut consumer = HeartbeatWatch::new(Duration::ZERO);
        consumer.received(0);
        consumer.booted();
        consumer.tick(u64::MAX);
        assert_eq!(consumer.state(), Heartbeat::Unconfigured);
        consumer.set_timeout(Duration::from_millis(5));
        assert_eq!(consumer.state(), Heartbeat::Unknown);
    }

    #[test]
    fn producer_keeps_its_period_without_catching_up() {
        let config =
            HostHeartbeat { node: NodeId::new(127).unwrap(), period: Duration::from_millis(10) };
        let mut producer = HeartbeatTimer::default();
        assert!(producer.is_due(0));
        producer.sent(3 * MS, &config);
        assert!(!producer.is_due(12 * MS));
        assert!(producer.is_due(13 * MS));
        producer.sent(14 * MS, &config);
        assert!(producer.is_due(23 * MS), "a late cycle does not shift the plan");
        producer.sent(100 * MS, &config);
        assert!(!producer.is_due(109 * MS));
        assert!(producer.is_due(110 * MS));
    }
}
