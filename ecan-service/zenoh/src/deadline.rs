//! Deadlines of requests that act, on the clock of their publisher.

use std::time::{Duration, Instant};

use ecan_service::client::Access;
#[cfg(any(feature = "engine", test))]
use ecan_service::client::{EXPIRED, INVALID_REQUEST, RpcError};
#[cfg(any(feature = "engine", test))]
use nix::time::{ClockId, clock_gettime};
use serde::{Deserialize, Serialize};

/// Longest time from now to a deadline. A publisher acts on no request that is older.
pub const MAX_LIFETIME: Duration = Duration::from_secs(10);

/// Answer of a publisher to `get PREFIX/publisher/*`: its identity and its clock.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct PublisherInfo {
    /// Identity of the publisher's connection to the service, random for each connection.
    pub publisher: String,
    /// Time of the publisher in nanoseconds since its host was started.
    pub now_ns: u64,
    /// [`MAX_LIFETIME`] in milliseconds.
    pub max_lifetime_ms: u64,
    /// Epoch of its publications, as in [`BatchHead::epoch`](crate::BatchHead::epoch).
    pub epoch: u64,
    /// Access of remote clients at present.
    pub access: Access,
    /// Reason without control.
    pub access_reason: Option<String>,
}

/// Clock of a publisher, as a client has received it.
#[derive(Debug, Clone, Copy)]
pub struct PublisherClock {
    now_ns: u64,
    received: Instant,
}

impl PublisherClock {
    /// Clock of an answer that arrived at `received`.
    pub fn new(info: &PublisherInfo, received: Instant) -> Self {
        Self { now_ns: info.now_ns, received }
    }

    /// Attachment of a request: its deadline, `lifetime` from now.
    ///
    /// The answer was older than its arrival, so that the deadline is early by the time that the
    /// answer travelled, and never late.
    pub fn deadline(&self, lifetime: Duration) -> [u8; 8] {
        let since_answer = nanoseconds(self.received.elapsed());
        let deadline = self.now_ns.saturating_add(since_answer);
        deadline.saturating_add(nanoseconds(lifetime)).to_le_bytes()
    }
}

fn nanoseconds(time: Duration) -> u64 {
    u64::try_from(time.as_nanos()).unwrap_or(u64::MAX)
}

/// Time of this host for deadlines. It also advances while the host is suspended.
#[cfg(any(feature = "engine", test))]
pub(crate) fn now_ns() -> u64 {
    clock_gettime(ClockId::CLOCK_BOOTTIME).map_or(0, |now| nanoseconds(now.into()))
}

/// Reads the deadline of a request that acts, and rejects a late request.
#[cfg(any(feature = "engine", test))]
pub(crate) fn check_deadline(
    method: &str,
    attachment: &[u8],
    now_ns: u64,
) -> Result<u64, RpcError> {
    let Ok(deadline) = attachment.try_into().map(u64::from_le_bytes) else {
        let text = format!(
            "{method} has no deadline: attachment of {} bytes; allowed: 8 bytes; add now_ns of the \
             publisher and the lifetime of the request",
            attachment.len()
        );
        return Err(RpcError::new(INVALID_REQUEST, text));
    };
    if deadline <= now_ns {
        let text = format!(
            "{method} is {} ms late, nothing was done; repeat it, or give it a longer lifetime",
            Duration::from_nanos(now_ns - deadline).as_millis()
        );
        return Err(RpcError::new(EXPIRED, text));
    }
    let lifetime = Duration::from_nanos(deadline - now_ns);
    if lifetime > MAX_LIFETIME {
        let text = format!(
            "deadline of {method} is {} ms from now; allowed: at most {}; use now_ns of this \
             publisher",
            lifetime.as_millis(),
            MAX_LIFETIME.as_millis()
        );
        return Err(RpcError::new(INVALID_REQUEST, text));
    }
    Ok(deadline)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn deadline_is_checked_on_the_clock_of_the_publisher() {
        let now = 1_000_000_000_000;
        let code = |deadline: u64| {
            check_deadline("nmt", &deadline.to_le_bytes(), now).map_err(|error| error.code)
        };
        let last = now + nanoseconds(MAX_LIFETIME);
        assert_eq!((code(now + 1), code(last)), (Ok(now + 1), Ok(last)));
        assert_eq!((code(now), code(0)), (Err(EXPIRED), Err(EXPIRED)));
        assert_eq!((code(last + 1), code(u64::MAX)), (Err(INVALID_REQUEST), Err(INVALID_REQUEST)));
        for wrong in [&[][..], &[0; 7], &[0; 9]] {
            assert_eq!(check_deadline("nmt", wrong, now).unwrap_err().code, INVALID_REQUEST);
        }
    }

    #[test]
    fn deadline_counts_from_the_present() {
        let received = Instant::now();
        let clock = PublisherClock { now_ns: 5_000_000_000, received };
        let deadline = u64::from_le_bytes(clock.deadline(Duration::from_secs(1)));
        let elapsed = nanoseconds(received.elapsed());
        assert!((6_000_000_000..=6_000_000_000 + elapsed).contains(&deadline), "{deadline}");
    }

    #[test]
    fn clock_of_deadlines_advances() {
        let first = now_ns();
        assert!(first > 0 && now_ns() >= first);
    }
}
