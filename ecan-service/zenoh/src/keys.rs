//! Key expressions.

use std::fmt;
use std::time::{Duration, Instant};

use ecan_protocol::text::Printable;
use ecan_service::client::Access;
#[cfg(any(feature = "engine", test))]
use ecan_service::client::{EXPIRED, INVALID_REQUEST, RpcError};
#[cfg(any(feature = "engine", test))]
use nix::time::{ClockId, clock_gettime};
use serde::{Deserialize, Serialize};
use thiserror::Error;

/// Key expressions of one service, under a prefix.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Keys {
    prefix: String,
}

/// Parts of the key of a request.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RequestKey<'a> {
    /// Identity of the publisher that the request addresses; `None` for any publisher.
    pub publisher: Option<&'a str>,
    /// Name of the client; empty if the request addresses any publisher.
    pub client: &'a str,
    /// Name of the method.
    pub method: &'a str,
}

/// The prefix is no key.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error(
    "prefix \"{}\" is invalid; allowed: names separated by single slashes, without * $ ? # and blanks",
    Printable(.0)
)]
pub struct PrefixError(pub String);

fn is_allowed(character: char) -> bool {
    !character.is_whitespace() && !"*$?#".contains(character)
}

impl Keys {
    /// Keys under this prefix.
    ///
    /// # Errors
    /// The prefix is empty or no key of Zenoh.
    pub fn new(prefix: &str) -> Result<Self, PrefixError> {
        let is_key =
            prefix.chars().all(is_allowed) && prefix.split('/').all(|part| !part.is_empty());
        let prefix = prefix.to_owned();
        if is_key { Ok(Self { prefix }) } else { Err(PrefixError(prefix)) }
    }

    /// Keys under the default prefix, `ecan/<host>/master<N>`.
    pub fn of_host(host: &str, master: u32) -> Self {
        let is_part = |character: &char| is_allowed(*character) && *character != '/';
        let host: String =
            host.chars().map(|found| if is_part(&found) { found } else { '-' }).collect();
        let host = if host.is_empty() { "localhost".to_owned() } else { host };
        Self { prefix: format!("ecan/{host}/master{master}") }
    }

    /// The prefix.
    pub fn prefix(&self) -> &str {
        &self.prefix
    }

    /// Liveliness token of a publisher; `*` for all.
    pub fn alive(&self, publisher: &str) -> String {
        format!("{}/alive/{publisher}", self.prefix)
    }

    /// Identity and clock of a publisher; `*` for all.
    pub fn publisher(&self, publisher: &str) -> String {
        format!("{}/publisher/{publisher}", self.prefix)
    }

    /// Request of a client to one publisher.
    pub fn request(&self, publisher: &str, client: &str, method: &str) -> String {
        format!("{}/publisher/{publisher}/{client}/{method}", self.prefix)
    }

    /// Frames of a channel.
    pub fn frames(&self, gateway: u16, channel: u8) -> String {
        format!("{}/frames/{gateway}/{channel}", self.prefix)
    }

    /// Frames of a subscription; `*` for gateway and channel of all.
    pub fn subscription(
        &self,
        name: &str,
        gateway: impl fmt::Display,
        channel: impl fmt::Display,
    ) -> String {
        format!("{}/subscriptions/{name}/{gateway}/{channel}", self.prefix)
    }

    /// Method or notification of the service.
    pub fn method(&self, method: &str) -> String {
        format!("{}/{method}", self.prefix)
    }

    /// The request of a key without wildcards; `None` if the key is not one of a request.
    pub fn request_of<'a>(&self, key: &'a str) -> Option<RequestKey<'a>> {
        let rest = key.strip_prefix(&self.prefix)?.strip_prefix('/')?;
        let parts: Vec<_> = rest.splitn(5, '/').collect();
        let (publisher, client, method) = match parts[..] {
            [method] => (None, "", method),
            ["publisher", publisher, client, method] => (Some(publisher), client, method),
            _ => return None,
        };
        (!rest.contains('*')).then_some(RequestKey { publisher, client, method })
    }
}

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
    fn keys_have_the_prefix_of_the_host() {
        let keys = Keys::of_host("cell 7/a*", 1);
        assert_eq!(keys.prefix(), "ecan/cell-7-a-/master1");
        assert_eq!(keys, Keys::new(keys.prefix()).unwrap());
        assert_eq!(keys.frames(2, 3), "ecan/cell-7-a-/master1/frames/2/3");
        let any = RequestKey { publisher: None, client: "", method: "sdo.upload" };
        assert_eq!(keys.request_of(&keys.method("sdo.upload")), Some(any));
        let one = RequestKey { publisher: Some("1f"), client: "hmi", method: "nmt" };
        assert_eq!(keys.request_of(&keys.request("1f", "hmi", "nmt")), Some(one));
        for key in [
            keys.frames(0, 0),
            "ecan/*/master1/nmt".into(),
            keys.method("*"),
            keys.publisher("1f"),
            keys.request("*", "hmi", "nmt"),
            keys.request("1f", "hmi", "a/b"),
        ] {
            assert_eq!(keys.request_of(&key), None, "{key}");
        }
        assert_eq!(Keys::of_host("", 0).prefix(), "ecan/localhost/master0");
    }

    #[test]
    fn prefix_that_is_no_key_is_rejected() {
        for prefix in ["", "/a", "a/", "a//b", "a/*", "a$", "a?", "#", "a b"] {
            let error = Keys::new(prefix).unwrap_err();
            assert!(error.to_string().contains("allowed"), "{error}");
        }
    }

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
