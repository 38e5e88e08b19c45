//! Key expressions.

use ecan_protocol::text::Printable;
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
        let is_part = |it: &char| is_allowed(*it) && *it != '/';
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
}
