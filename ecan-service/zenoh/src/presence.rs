//! Presence of a publisher: its identity, its liveliness token, and other publishers with its prefix.

use std::collections::BTreeSet;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use ecan_service::client::{Client, ClientError, Method as _, NOT_AVAILABLE, RpcError, methods};
use serde_json::Value;
use zenoh::Wait as _;
use zenoh::config::ZenohId;
use zenoh::liveliness::LivelinessToken;
use zenoh::pubsub::Subscriber;
use zenoh::sample::SampleKind;

use crate::publication::{Publication, PublicationError, lock};

/// Interval of the requests that test the service.
const HEARTBEAT: Duration = Duration::from_millis(500);
/// Time for the response to such a request. The service answers it without the bus, so that a longer
/// time means that its thread does not run.
const HEARTBEAT_TIMEOUT: Duration = Duration::from_secs(2);
/// Other publishers that are remembered.
const MAX_OTHERS: usize = 16;
/// Bytes of their keys that are remembered.
const MAX_TOKEN_BYTES: usize = 256;

/// Presence during one connection to the service.
#[derive(Debug)]
pub(crate) struct Presence {
    /// Identity, random for each connection: also hosts with the same disk image differ.
    pub(crate) publisher: String,
    others: Arc<Mutex<Others>>,
    is_silent: AtomicBool,
}

/// Liveliness tokens of other publishers.
#[derive(Debug, Default)]
struct Others {
    tokens: BTreeSet<String>,
    /// There were more than are remembered, so that the end of these proves nothing.
    has_overflow: bool,
}

impl Others {
    fn observe(&mut self, kind: SampleKind, token: &str) {
        let token =
            (0..=MAX_TOKEN_BYTES).rev().find_map(|end| token.get(..end)).unwrap_or_default();
        match kind {
            SampleKind::Delete => drop(self.tokens.remove(token)),
            SampleKind::Put if self.tokens.len() < MAX_OTHERS => {
                self.tokens.insert(token.to_owned());
            }
            SampleKind::Put => self.has_overflow |= !self.tokens.contains(token),
        }
    }

    fn first(&self) -> Option<String> {
        let overflow = || self.has_overflow.then(|| format!("more than {MAX_OTHERS} publishers"));
        self.tokens.first().cloned().or_else(overflow)
    }
}

impl Presence {
    pub(crate) fn new() -> Self {
        Self {
            publisher: ZenohId::default().to_string(),
            others: Arc::default(),
            is_silent: AtomicBool::new(false),
        }
    }

    /// Observes the tokens of other publishers until the subscriber is dropped.
    pub(crate) fn watch_others(
        &self,
        publication: &Publication,
    ) -> Result<Subscriber<()>, PublicationError> {
        let keys = &publication.config.keys;
        let (own, all) = (keys.alive(&self.publisher), keys.alive("*"));
        let others = self.others.clone();
        let subscriber = publication.session.liveliness().declare_subscriber(&all).history(true);
        let subscriber = subscriber.callback(move |sample| {
            let token = sample.key_expr().as_str();
            if token != own {
                lock(&others).observe(sample.kind(), token);
            }
        });
        subscriber.wait().map_err(PublicationError::session("observe", &all))
    }

    /// Key of the token of another publisher with the prefix.
    pub(crate) fn other(&self) -> Option<String> {
        lock(&self.others).first()
    }

    pub(crate) fn is_silent(&self) -> bool {
        self.is_silent.load(Ordering::Acquire)
    }

    /// Checks that the service responds.
    pub(crate) fn check_service(&self) -> Result<(), RpcError> {
        if !self.is_silent() {
            return Ok(());
        }
        let text = format!(
            "the service has not responded for {} s; nothing was done; retry when PREFIX/alive/* \
             exists again",
            HEARTBEAT_TIMEOUT.as_secs()
        );
        Err(RpcError::new(NOT_AVAILABLE, text))
    }

    /// Checks that the prefix belongs to this publisher only.
    pub(crate) fn check_prefix(&self) -> Result<(), RpcError> {
        match self.other() {
            None => Ok(()),
            Some(token) => {
                let text = format!(
                    "another publisher uses the prefix ({token}); nothing was done; give each \
                     publisher a --prefix of its own"
                );
                Err(RpcError::new(NOT_AVAILABLE, text))
            }
        }
    }

    /// Keeps the token while the service responds, until the sender of `ended` is dropped.
    pub(crate) fn run(&self, publication: &Publication, caller: &Client, ended: &Receiver<()>) {
        let mut token: Option<LivelinessToken> = None;
        loop {
            let method = methods::ReadServiceStats::NAME;
            match caller.call_within(method, Value::Null, HEARTBEAT_TIMEOUT) {
                // The publishing thread reports a lost connection.
                Err(ClientError::Closed | ClientError::Io(_)) => return,
                Err(ClientError::Timeout { .. }) => {
                    self.is_silent.store(true, Ordering::Release);
                    token = None;
                }
                // Each response, also an error, proves that the service runs.
                _ => {
                    self.is_silent.store(false, Ordering::Release);
                    if token.is_none() {
                        let key = publication.config.keys.alive(&self.publisher);
                        let declared = publication.session.liveliness().declare_token(&key).wait();
                        // Tried again with the next response.
                        token = declared.inspect_err(|error| log_failure(&key, error)).ok();
                    }
                }
            }
            if ended.recv_timeout(HEARTBEAT) == Err(RecvTimeoutError::Disconnected) {
                return;
            }
        }
    }
}

fn log_failure(key: &str, error: &zenoh::Error) {
    tracing::warn!("zenoh: cannot declare {key}: {error}");
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn other_publishers_are_known_until_all_have_ended() {
        let presence = Presence::new();
        let observe = |kind, token: &str| lock(&presence.others).observe(kind, token);
        assert_eq!((presence.other(), presence.check_prefix()), (None, Ok(())));
        observe(SampleKind::Put, "p/alive/2");
        observe(SampleKind::Put, "p/alive/3");
        observe(SampleKind::Delete, "p/alive/2");
        assert_eq!(presence.other().as_deref(), Some("p/alive/3"));
        assert_eq!(presence.check_prefix().unwrap_err().code, NOT_AVAILABLE);
        observe(SampleKind::Delete, "p/alive/3");
        assert_eq!(presence.other(), None);
    }

    #[test]
    fn remembered_publishers_are_bounded_and_never_forgotten() {
        let mut others = Others::default();
        let token = |number| format!("p/alive/{number}{}", "x".repeat(1000));
        (0..1000).for_each(|number| others.observe(SampleKind::Put, &token(number)));
        assert_eq!(others.tokens.len(), MAX_OTHERS);
        assert!(others.tokens.iter().all(|token| token.len() <= MAX_TOKEN_BYTES));
        (0..1000).for_each(|number| others.observe(SampleKind::Delete, &token(number)));
        assert!(others.tokens.is_empty() && others.first().is_some());
    }

    #[test]
    fn identities_differ() {
        assert_ne!(Presence::new().publisher, Presence::new().publisher);
    }
}
