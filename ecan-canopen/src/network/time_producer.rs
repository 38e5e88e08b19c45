//! Production of TIME (CiA 301, 7.2.6) from the host's clock.

use std::time::{Duration, SystemTime, UNIX_EPOCH};

use super::error::NetworkError;
use super::period_timer::nanoseconds;
use crate::TimeOfDay;

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
    pub(super) fn check(&self) -> Result<(), NetworkError> {
        let unix_ns = self.reference.unix_ns;
        match TimeOfDay::from_unix_ns(unix_ns) {
            Some(_) => Ok(()),
            None => Err(NetworkError::TimeReference { unix_ns }),
        }
    }

    /// The message at a time of the bus clock; `None` beyond the range of TIME.
    pub(super) fn message(&self, now_ns: u64) -> Option<[u8; 6]> {
        TimeOfDay::from_unix_ns(self.reference.unix_ns_at(now_ns)).map(TimeOfDay::to_bytes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
            TimeConfig { period, reference: TimeReference { unix_ns, bus_ns: 0 } }.check()
        };
        assert_eq!(with(0), Err(NetworkError::TimeReference { unix_ns: 0 }));
        assert_eq!(with(TimeReference::from_system_clock(0).unix_ns), Ok(()));
    }
}
