//! The publication of a service.

use std::fmt;
use std::path::Path;
use std::sync::mpsc::{Receiver, sync_channel};
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

use ecan_service_client::Hello;
use zenoh::pubsub::Subscriber;
use zenoh::sample::SampleKind;
use zenoh::{Session, Wait as _};

use crate::frame_batches::FrameBatches;
use crate::keys::Keys;
use crate::publication_error::PublicationError;
use crate::zenoh_config;

/// Settings of a publication.
#[derive(Debug, Clone)]
pub struct PublicationConfig {
    /// Key expressions.
    pub keys: Keys,
    /// Remote clients may send frames and change something, if the service permits it to this
    /// process.
    pub has_control: bool,
    /// Interval of the states.
    pub interval: Duration,
}

/// Event of a publication, with its text for users.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub enum PublicationEvent {
    /// The connections of the session, at the start and after each change.
    Links {
        /// Zenoh routers.
        routers: usize,
        /// Zenoh peers; clients that connect to a listener are not counted.
        peers: usize,
    },
    /// Another session publishes under the same keys: its data and these are mixed.
    PrefixInUse {
        /// Key of its liveliness token, which ends with its Zenoh ID.
        token: String,
    },
}

impl fmt::Display for PublicationEvent {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Links { routers, peers } => {
                write!(f, "zenoh: connected to {routers} routers, {peers} peers")
            }
            Self::PrefixInUse { token } => {
                write!(f, "warning: another publisher uses the prefix ({token}); set --prefix")
            }
        }
    }
}

/// A Zenoh session that publishes services.
#[derive(Debug)]
pub struct Publication {
    pub(crate) session: Session,
    pub(crate) config: PublicationConfig,
}

/// What the publishing thread shares with those that answer queries.
#[derive(Debug)]
pub(crate) struct Published {
    pub(crate) hello: Mutex<Hello>,
    pub(crate) batches: Mutex<FrameBatches>,
}

impl Publication {
    /// Opens a session with a configuration file of Zenoh (JSON5), unchanged; nothing listens and
    /// multicast scouting is off unless it is configured.
    ///
    /// # Errors
    /// The file is wrong, or the session does not open.
    pub fn open(file: &Path, config: PublicationConfig) -> Result<Self, PublicationError> {
        let session = zenoh::open(zenoh_config::read(file)?).wait();
        let session =
            session.map_err(|error| PublicationError::Open { reason: error.to_string() })?;
        Ok(Self { session, config })
    }

    pub(crate) fn links(&self) -> PublicationEvent {
        let info = self.session.info();
        let (routers, peers) = (info.routers_zid().wait(), info.peers_zid().wait());
        PublicationEvent::Links { routers: routers.count(), peers: peers.count() }
    }

    /// Key of the liveliness token.
    pub(crate) fn token(&self) -> String {
        self.config.keys.alive(&self.session.zid().to_string())
    }

    /// Reports other publishers with the same keys.
    pub(crate) fn watch_prefix(
        &self,
    ) -> Result<(Subscriber<()>, Receiver<String>), PublicationError> {
        let (sender, others) = sync_channel(1);
        let (own, tokens) = (self.token(), self.config.keys.alive("*"));
        let subscriber = self.session.liveliness().declare_subscriber(&tokens).history(true);
        let subscriber = subscriber.callback(move |token| {
            if token.kind() == SampleKind::Put && token.key_expr().as_str() != own {
                // One is enough.
                let _ = sender.try_send(token.key_expr().to_string());
            }
        });
        let subscriber =
            subscriber.wait().map_err(PublicationError::session("observe", &tokens))?;
        Ok((subscriber, others))
    }

    /// The response to `hello`, with the access of remote clients.
    pub(crate) fn remote_hello(&self, hello: &Hello) -> Hello {
        let mut hello = hello.clone();
        if !self.config.has_control {
            hello.access = ecan_service_client::Access::Read;
            hello.access_reason =
                Some("remote clients only read; start ecan zenoh with --control".into());
        }
        hello
    }
}

pub(crate) fn lock<T>(mutex: &Mutex<T>) -> std::sync::MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
