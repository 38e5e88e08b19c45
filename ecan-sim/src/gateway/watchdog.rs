use super::NS_PER_MS;

const DEFAULT_TIMEOUT_NS: u64 = 100 * NS_PER_MS;

/// Process data watchdog. Each complete SM2 write feeds it.
#[derive(Debug)]
pub(super) struct Watchdog {
    timeout_ns: u64,
    expirations: u32,
    is_expired: bool,
    fed_at: u64,
}

impl Watchdog {
    pub(super) fn new() -> Self {
        Self { timeout_ns: DEFAULT_TIMEOUT_NS, expirations: 0, is_expired: false, fed_at: 0 }
    }

    /// Sets the timeout in nanoseconds; 0 disables the watchdog.
    pub(super) fn set_timeout_ns(&mut self, timeout_ns: u64) {
        self.timeout_ns = timeout_ns;
    }

    /// Starts the timeout, as the transition to OP does.
    pub(super) fn start(&mut self, now: u64) {
        self.fed_at = now;
    }

    pub(super) fn feed(&mut self, now: u64) {
        self.is_expired = false;
        self.fed_at = now;
    }

    pub(super) fn fed_at(&self) -> u64 {
        self.fed_at
    }

    /// When it expires; `None` while it is disabled.
    pub(super) fn expiry(&self) -> Option<u64> {
        (self.timeout_ns > 0).then(|| self.fed_at.saturating_add(self.timeout_ns))
    }

    pub(super) fn expire(&mut self) {
        self.expirations += 1;
        self.is_expired = true;
    }

    pub(super) fn expirations(&self) -> u32 {
        self.expirations
    }

    pub(super) fn is_expired(&self) -> bool {
        self.is_expired
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn expired_watchdog_recovers_when_fed() {
        let mut watchdog = Watchdog::new();
        watchdog.start(10);
        assert_eq!(watchdog.expiry(), Some(10 + DEFAULT_TIMEOUT_NS));
        watchdog.expire();
        assert_eq!((watchdog.is_expired(), watchdog.expirations()), (true, 1));
        watchdog.feed(20);
        assert_eq!((watchdog.is_expired(), watchdog.expirations()), (false, 1));
        assert_eq!(watchdog.fed_at(), 20);
    }

    #[test]
    fn zero_timeout_disables_the_watchdog() {
        let mut watchdog = Watchdog::new();
        watchdog.set_timeout_ns(0);
        assert_eq!(watchdog.expiry(), None);
    }
}
