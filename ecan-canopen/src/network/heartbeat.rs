//! Heartbeat consumer of one node (CiA 301, 7.2.8.3.2.2).

use std::time::Duration;

use super::period_timer::nanoseconds;

ecan_protocol::text_enum! {
    /// Life sign of a node: heartbeat, or response to node guarding.
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

#[cfg(test)]
mod tests {
    use super::*;

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
}
