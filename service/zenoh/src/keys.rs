//! Key expressions.

use thiserror::Error;

/// Key expressions of one service, under a prefix.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Keys {
    prefix: String,
}

/// The prefix is no key.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error(
    "prefix \"{0}\" is invalid; allowed: names separated by single slashes, without * $ ? # and blanks"
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
        let is_key = prefix.chars().all(is_allowed) && prefix.split('/').all(|it| !it.is_empty());
        let prefix = prefix.to_owned();
        if is_key { Ok(Self { prefix }) } else { Err(PrefixError(prefix)) }
    }

    /// Keys under the default prefix, `ecan/<host>/master<N>`.
    pub fn of_host(host: &str, master: u32) -> Self {
        let is_part = |it: &char| is_allowed(*it) && *it != '/';
        let host: String = host.chars().map(|it| if is_part(&it) { it } else { '-' }).collect();
        let host = if host.is_empty() { "localhost".to_owned() } else { host };
        Self { prefix: format!("ecan/{host}/master{master}") }
    }

    /// The prefix.
    pub fn prefix(&self) -> &str {
        &self.prefix
    }

    /// Liveliness token of the publisher with this Zenoh ID.
    pub fn alive(&self, id: &str) -> String {
        format!("{}/alive/{id}", self.prefix)
    }

    /// Frames of a channel.
    pub fn frames(&self, gateway: u16, channel: u8) -> String {
        format!("{}/frames/{gateway}/{channel}", self.prefix)
    }

    /// Method or notification of the service.
    pub fn method(&self, method: &str) -> String {
        format!("{}/{method}", self.prefix)
    }

    /// The method of a key without wildcards.
    pub fn method_of<'a>(&self, key: &'a str) -> Option<&'a str> {
        let method = key.strip_prefix(&self.prefix)?.strip_prefix('/')?;
        (!method.contains(['/', '*'])).then_some(method)
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
        assert_eq!(keys.method_of(&keys.method("sdo.upload")), Some("sdo.upload"));
        assert_eq!(keys.method_of(&keys.frames(0, 0)), None);
        assert_eq!(keys.method_of("ecan/*/master1/nmt"), None);
        assert_eq!(keys.method_of(&keys.method("*")), None);
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
