//! When the startup of a gateway is requested again.
//!
//! A master does not repeat a startup that failed, and the cycle cannot ask whether it did: the error
//! flag is behind the master's semaphore. A request has no effect on a slave that is in OP or is being
//! configured.

/// Time in one state below OP before the first request, in nanoseconds.
const FIRST_NS: u64 = 2_000_000_000;
/// Longest interval between two requests, in nanoseconds.
const LONGEST_NS: u64 = 30_000_000_000;

#[derive(Debug, Default)]
pub(crate) struct StartupRetry {
    requests: u32,
    next_ns: u64,
    is_due: bool,
}

impl StartupRetry {
    /// The slave is in OP, or gone.
    pub(crate) fn reset(&mut self) {
        *self = Self::default();
    }

    /// The slave has been in one state below OP since `since_ns`.
    pub(crate) fn watch(&mut self, since_ns: u64, now_ns: u64) {
        self.is_due = now_ns >= self.next_ns.max(since_ns.saturating_add(FIRST_NS));
    }

    /// Requests no startup at present: what the slave does may still lead to OP.
    pub(crate) fn postpone(&mut self) {
        self.is_due = false;
    }

    pub(crate) fn is_due(&self) -> bool {
        self.is_due
    }

    /// The startup of all slaves was requested. Returns the number of requests for this one, or
    /// `None` if it was not due.
    pub(crate) fn requested(&mut self, now_ns: u64) -> Option<u32> {
        if !std::mem::take(&mut self.is_due) {
            return None;
        }
        self.requests = self.requests.saturating_add(1);
        let interval_ns = FIRST_NS.checked_shl(self.requests.min(16)).unwrap_or(LONGEST_NS);
        self.next_ns = now_ns.saturating_add(interval_ns.min(LONGEST_NS));
        Some(self.requests)
    }

    pub(crate) fn requests(&self) -> u32 {
        self.requests
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn requests_follow_at_increasing_intervals_until_op() {
        let mut retry = StartupRetry::default();
        let mut seconds = Vec::new();
        let mut run = |retry: &mut StartupRetry| {
            seconds.clear();
            for second in 10..110 {
                retry.watch(10_000_000_000, second * 1_000_000_000);
                if retry.requested(second * 1_000_000_000).is_some() {
                    seconds.push(second - 10);
                }
            }
            assert_eq!(seconds, [2, 6, 14, 30, 60, 90]);
        };
        run(&mut retry);
        retry.reset();
        run(&mut retry);
    }
}
