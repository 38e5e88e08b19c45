use super::NS_PER_MS;

const DEFAULT_TIMEOUT_NS: u64 = 100 * NS_PER_MS;

/// Process data watchdog. Each complete SM2 write feeds it.
#[derive(Clone, Debug)]
pub(super) struct Watchdog {
    /// 0 disables it.
    pub(super) timeout_ns: u64,
    /// Since power-on or reboot.
    pub(super) expirations: u32,
    /// It has expired and was not fed since.
    pub(super) is_expired: bool,
    pub(super) fed_at: u64,
}

impl Watchdog {
    pub(super) fn new() -> Self {
        Self { timeout_ns: DEFAULT_TIMEOUT_NS, expirations: 0, is_expired: false, fed_at: 0 }
    }

    pub(super) fn feed(&mut self, now: u64) {
        self.is_expired = false;
        self.fed_at = now;
    }

    /// When it expires; `None` while it is disabled.
    pub(super) fn expiry(&self) -> Option<u64> {
        (self.timeout_ns > 0).then(|| self.fed_at.saturating_add(self.timeout_ns))
    }

    pub(super) fn expire(&mut self) {
        self.expirations += 1;
        self.is_expired = true;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn expired_watchdog_recovers_when_fed() {
        let mut watchdog = Watchdog::new();
        watchdog.fed_at = 10;
        assert_eq!(watchdog.expiry(), Some(10 + DEFAULT_TIMEOUT_NS));
        watchdog.expire();
        assert_eq!((watchdog.is_expired, watchdog.expirations), (true, 1));
        watchdog.feed(20);
        assert_eq!((watchdog.is_expired, watchdog.expirations), (false, 1));
        assert_eq!(watchdog.fed_at, 20);
    }

    #[test]
    fn zero_timeout_disables_the_watchdog() {
        let mut watchdog = Watchdog::new();
        watchdog.timeout_ns = 0;
        assert_eq!(watchdog.expiry(), None);
    }
}
