//! Life sign of one node: its heartbeat, or node guarding in its place (CiA 301, 7.2.8.3.2).

use std::time::Duration;

use super::config::{GuardingConfig, Step};
use super::producers::{PeriodTimer, nanoseconds};
use crate::{GuardResponse, NmtState, object};

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
    pub(super) fn on_heartbeat(&mut self, now_ns: u64) -> bool {
        let was_overdue = self.state == Heartbeat::TimedOut;
        if self.timeout_ns > 0 {
            self.state = Heartbeat::Active;
            self.deadline_ns = now_ns.saturating_add(self.timeout_ns);
        }
        was_overdue
    }

    /// The boot-up message is not a heartbeat: the watch begins with the first heartbeat.
    pub(super) fn on_boot_up(&mut self) {
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

impl GuardingConfig {
    /// Steps that enable life guarding in the node: heartbeat producer off, if it has one, then 0x100C and 0x100D.
    /// A guard time out of range counts as the nearest allowed one; [`Network::add_node`](crate::Network::add_node)
    /// rejects it.
    pub fn steps(&self) -> [Step; 3] {
        let ms = self.guard_time.as_millis().clamp(1, u128::from(u16::MAX)) as u16;
        [
            Step::write(object::PRODUCER_HEARTBEAT, 0, 0u16).named("heartbeat off").if_present(),
            Step::write(object::GUARD_TIME, 0, ms).named("guard time"),
            Step::write(object::LIFE_TIME_FACTOR, 0, self.life_time_factor)
                .named("life time factor"),
        ]
    }
}

/// Counters of guarding errors of a node.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub struct GuardErrors {
    /// Responses whose toggle bit did not alternate; they count as not received.
    pub toggle: u32,
    /// Responses with another NMT state than the last command leads to.
    pub state: u32,
}

/// Result of a guarding response.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum GuardResult {
    /// Valid; `true` if the node was overdue.
    Accepted(bool),
    /// The toggle bit did not alternate.
    Toggle,
    /// Valid, with another NMT state than expected; `true` if the node was overdue.
    State(bool),
}

/// Kind of the last response, to report an error once.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
enum LastResponse {
    #[default]
    Valid,
    Toggle,
    State,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct NodeGuard {
    config: GuardingConfig,
    state: Heartbeat,
    timer: PeriodTimer,
    /// End of the life time; `None` before the first request.
    deadline_ns: Option<u64>,
    /// Toggle bit of the next response; `None` accepts both.
    toggle: Option<bool>,
    /// NMT state that the response to the last request reports.
    expected: Option<NmtState>,
    last: LastResponse,
    /// The last error differs from the one before.
    is_new_error: bool,
    pub(super) timeouts: u32,
    pub(super) errors: GuardErrors,
}

impl NodeGuard {
    pub(super) fn new(config: GuardingConfig) -> Self {
        Self {
            config,
            state: Heartbeat::Unknown,
            timer: PeriodTimer::default(),
            deadline_ns: None,
            toggle: None,
            expected: None,
            last: LastResponse::default(),
            is_new_error: false,
            timeouts: 0,
            errors: GuardErrors::default(),
        }
    }

    #[inline]
    pub(super) fn state(&self) -> Heartbeat {
        self.state
    }

    pub(super) fn is_due(&self, now_ns: u64) -> bool {
        self.timer.is_due(now_ns)
    }

    /// A request was sent to a node whose NMT state should be `expected`.
    pub(super) fn on_request_sent(&mut self, now_ns: u64, expected: Option<NmtState>) {
        self.timer.advance(now_ns, self.config.guard_time);
        self.expected = expected;
        if self.deadline_ns.is_none() && self.state != Heartbeat::TimedOut {
            self.extend(now_ns);
        }
    }

    /// The host sent an NMT command: the response to the last request may report either state.
    pub(super) fn on_command(&mut self) {
        self.expected = None;
    }

    pub(super) fn on_response(&mut self, response: GuardResponse, now_ns: u64) -> GuardResult {
        if self.toggle.is_some_and(|toggle| toggle != response.toggle) {
            self.errors.toggle = self.errors.toggle.saturating_add(1);
            self.note(LastResponse::Toggle);
            return GuardResult::Toggle;
        }
        self.toggle = Some(!response.toggle);
        let was_overdue = self.state == Heartbeat::TimedOut;
        self.state = Heartbeat::Active;
        self.extend(now_ns);
        if self.expected.take().is_some_and(|expected| expected != response.state) {
            self.errors.state = self.errors.state.saturating_add(1);
            self.note(LastResponse::State);
            return GuardResult::State(was_overdue);
        }
        self.note(LastResponse::Valid);
        GuardResult::Accepted(was_overdue)
    }

    fn note(&mut self, response: LastResponse) {
        self.is_new_error = response != LastResponse::Valid && response != self.last;
        self.last = response;
    }

    /// Returns whether the last response has an error that the one before did not have.
    pub(super) fn has_new_error(&self) -> bool {
        self.is_new_error
    }

    /// The node booted: its first response has the toggle bit 0.
    pub(super) fn on_boot_up(&mut self) {
        self.state = Heartbeat::Unknown;
        self.toggle = Some(false);
        self.expected = None;
        self.deadline_ns = None;
    }

    /// No request is sent: the life time stops.
    pub(super) fn pause(&mut self) {
        self.deadline_ns = None;
        self.timer.reset();
    }

    /// Returns whether the node became overdue.
    pub(super) fn tick(&mut self, now_ns: u64) -> bool {
        let is_overdue = self.deadline_ns.is_some_and(|deadline| now_ns > deadline);
        if is_overdue {
            self.deadline_ns = None;
            self.state = Heartbeat::TimedOut;
            self.timeouts = self.timeouts.saturating_add(1);
            // A node that restarted without boot-up message begins with toggle bit 0.
            self.toggle = None;
        }
        is_overdue
    }

    fn extend(&mut self, now_ns: u64) {
        let life_ns = nanoseconds(self.config.life_time());
        self.deadline_ns = Some(now_ns.saturating_add(life_ns));
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
        consumer.on_heartbeat(1_000 * MS);
        consumer.tick(1_100 * MS);
        assert_eq!(consumer.state(), Heartbeat::Active, "exactly in time");
        consumer.tick(1_100 * MS + 1);
        assert_eq!((consumer.state(), consumer.timeouts()), (Heartbeat::TimedOut, 1));
        consumer.tick(9_000 * MS);
        assert_eq!(consumer.timeouts(), 1, "counted once");
        consumer.on_heartbeat(9_001 * MS);
        assert_eq!(consumer.state(), Heartbeat::Active);
    }

    #[test]
    fn boot_up_message_is_not_a_heartbeat() {
        let mut consumer = HeartbeatWatch::new(Duration::from_millis(100));
        consumer.on_heartbeat(0);
        consumer.on_boot_up();
        consumer.tick(500 * MS);
        assert_eq!((consumer.state(), consumer.timeouts()), (Heartbeat::Unknown, 0));
    }

    #[test]
    fn zero_timeout_disables_the_watch() {
        let mut consumer = HeartbeatWatch::new(Duration::ZERO);
        consumer.on_heartbeat(0);
        consumer.on_boot_up();
        consumer.tick(u64::MAX);
        assert_eq!(consumer.state(), Heartbeat::Unconfigured);
        consumer.set_timeout(Duration::from_millis(5));
        assert_eq!(consumer.state(), Heartbeat::Unknown);
    }
}

#[cfg(test)]
mod guarding_tests {
    use std::time::Duration;

    use super::*;

    const MS: u64 = 1_000_000;
    const CONFIG: GuardingConfig =
        GuardingConfig { guard_time: Duration::from_millis(10), life_time_factor: 3 };

    fn response(toggle: bool) -> GuardResponse {
        GuardResponse { toggle, state: NmtState::Operational }
    }

    #[test]
    fn responses_alternate_and_keep_the_node_alive() {
        let mut guard = NodeGuard::new(CONFIG);
        guard.on_boot_up();
        for nth in 0..10u64 {
            assert!(guard.is_due(nth * 10 * MS));
            guard.on_request_sent(nth * 10 * MS, None);
            assert!(!guard.is_due(nth * 10 * MS + 1));
            let result = guard.on_response(response(nth % 2 == 1), nth * 10 * MS + MS);
            assert_eq!(result, GuardResult::Accepted(false));
            assert!(!guard.tick(nth * 10 * MS + MS));
            assert_eq!(guard.state(), Heartbeat::Active);
        }
        // The last response came at 91 ms.
        assert!(!guard.tick(121 * MS), "exactly in time");
        assert!(guard.tick(121 * MS + 1));
        assert_eq!((guard.state(), guard.timeouts), (Heartbeat::TimedOut, 1));
        assert!(!guard.tick(999 * MS), "counted once");
        guard.on_request_sent(1_000 * MS, None);
        assert!(!guard.tick(2_000 * MS), "still lost");
        assert_eq!(guard.on_response(response(true), 2_000 * MS), GuardResult::Accepted(true));
        assert_eq!(guard.state(), Heartbeat::Active);
    }

    #[test]
    fn node_that_never_responds_is_lost() {
        let mut guard = NodeGuard::new(CONFIG);
        assert!(!guard.tick(1_000 * MS), "no request, no life time");
        for nth in 0..4 {
            guard.on_request_sent(1_000 * MS + nth * 10 * MS, None);
        }
        assert!(!guard.tick(1_030 * MS));
        assert!(guard.tick(1_030 * MS + 1));
        guard.on_boot_up();
        assert_eq!(guard.state(), Heartbeat::Unknown);
    }

    #[test]
    fn repeated_toggle_bit_counts_as_not_received() {
        let mut guard = NodeGuard::new(CONFIG);
        guard.on_boot_up();
        guard.on_request_sent(0, None);
        assert_eq!(guard.on_response(response(true), MS), GuardResult::Toggle);
        assert!(guard.has_new_error());
        assert_eq!(guard.on_response(response(true), MS), GuardResult::Toggle);
        assert!(!guard.has_new_error(), "reported once");
        assert_eq!(guard.on_response(response(false), MS), GuardResult::Accepted(false));
        guard.on_request_sent(10 * MS, None);
        assert_eq!(guard.on_response(response(false), 11 * MS), GuardResult::Toggle);
        assert!(guard.has_new_error(), "a valid one was in between");
        assert_eq!(guard.errors, GuardErrors { toggle: 3, state: 0 });
        assert!(guard.tick(31 * MS + 1), "the life time runs since 1 ms");
    }

    #[test]
    fn unexpected_state_is_counted_unless_a_command_is_running() {
        let mut guard = NodeGuard::new(CONFIG);
        guard.on_request_sent(0, Some(NmtState::Operational));
        assert_eq!(guard.on_response(response(false), 0), GuardResult::Accepted(false));
        guard.on_request_sent(10 * MS, Some(NmtState::Stopped));
        assert_eq!(guard.on_response(response(true), 11 * MS), GuardResult::State(false));
        guard.on_request_sent(20 * MS, Some(NmtState::Stopped));
        guard.on_command();
        assert_eq!(guard.on_response(response(false), 21 * MS), GuardResult::Accepted(false));
        assert_eq!(guard.errors, GuardErrors { toggle: 0, state: 1 });
    }

    #[test]
    fn paused_guarding_loses_no_node() {
        let mut guard = NodeGuard::new(CONFIG);
        guard.on_request_sent(0, None);
        guard.pause();
        assert!(!guard.tick(1_000 * MS));
        assert!(guard.is_due(1_000 * MS));
    }

    #[test]
    fn guard_time_is_whole_milliseconds_in_range() {
        let with = |guard_time, life_time_factor| {
            GuardingConfig { guard_time, life_time_factor }.checked_ms()
        };
        assert_eq!(with(Duration::from_millis(65_535), 255), Some(65_535));
        for (guard_time, factor) in [
            (Duration::ZERO, 1),
            (Duration::from_micros(1_500), 1),
            (Duration::from_millis(65_536), 1),
            (Duration::from_millis(100), 0),
        ] {
            assert_eq!(with(guard_time, factor), None);
        }
    }
}
