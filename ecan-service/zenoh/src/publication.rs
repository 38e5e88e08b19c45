//! The publication of a service.

use std::fmt;
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, SystemTime};

use ecan_protocol::text::Printable;
use ecan_service::client::Hello;
use zenoh::{Session, Wait as _};

use crate::frame_batches::FrameBatches;
use crate::keys::Keys;
use crate::publication_error::PublicationError;
use crate::transmit_limits::TransmitLimits;
use crate::zenoh_config;

/// Settings of a publication.
#[derive(Debug, Clone)]
pub struct PublicationConfig {
    /// Key expressions.
    pub keys: Keys,
    /// Remote clients may send frames and change something, if the service permits it to this
    /// process.
    pub has_control: bool,
    /// Frames that remote clients with control may send.
    pub limits: TransmitLimits,
    /// Interval of the states.
    pub interval: Duration,
}

/// Requests of remote clients that the publisher rejected since its start.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct RejectedRequests {
    /// Requests and frames that were late.
    pub late: u64,
    /// Requests that exceeded a limit of the publisher.
    pub full: u64,
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
    /// Another publisher uses the same keys: its publications and these are mixed, and both reject
    /// requests that act.
    PrefixInUse {
        /// Key of its liveliness token, which ends with its identity.
        token: String,
    },
    /// No other publisher uses the keys any more.
    PrefixFree,
    /// The service responds no more: the liveliness token is withdrawn and requests are rejected.
    ServiceSilent,
    /// The service responds again.
    ServiceResponds,
    /// Requests were rejected, at most once per second.
    Rejected(RejectedRequests),
}

impl fmt::Display for PublicationEvent {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Links { routers, peers } => {
                write!(f, "zenoh: connected to {routers} routers, {peers} peers")
            }
            Self::PrefixInUse { token } => write!(
                f,
                "warning: another publisher uses the prefix ({}); remote control is rejected; \
                 set --prefix",
                Printable(token)
            ),
            Self::PrefixFree => f.write_str("zenoh: no other publisher uses the prefix"),
            Self::ServiceSilent => {
                f.write_str("warning: the service does not respond; remote requests are rejected")
            }
            Self::ServiceResponds => f.write_str("service responds again"),
            Self::Rejected(RejectedRequests { late, full }) => {
                write!(f, "zenoh: remote requests rejected: {late} late, {full} beyond a limit")
            }
        }
    }
}

/// A Zenoh session that publishes services.
#[derive(Debug)]
pub struct Publication {
    pub(crate) session: Session,
    pub(crate) config: PublicationConfig,
    /// The counters continue over connections to the service.
    pub(crate) batches: Arc<Mutex<FrameBatches>>,
    pub(crate) rejected: Arc<Mutex<RejectedRequests>>,
    open_control: Option<String>,
}

impl Publication {
    /// Opens a session with a configuration file of Zenoh (JSON5), unchanged except for three
    /// defaults: nothing listens, multicast scouting is off, and received messages have at most 1 MiB
    /// unless it is configured.
    ///
    /// # Errors
    /// The file is wrong, or the session does not open.
    pub fn open(file: &Path, config: PublicationConfig) -> Result<Self, PublicationError> {
        let (zenoh_config, open_control) = zenoh_config::read(file)?;
        let session = zenoh::open(zenoh_config).wait();
        let session =
            session.map_err(|error| PublicationError::Open { reason: error.to_string() })?;
        let epoch = SystemTime::UNIX_EPOCH.elapsed().unwrap_or_default().as_nanos();
        let batches = FrameBatches::new(u64::try_from(epoch).unwrap_or_default());
        let (batches, rejected) = (Arc::new(Mutex::new(batches)), Arc::default());
        let open_control = open_control.filter(|_| config.has_control);
        Ok(Self { session, config, batches, rejected, open_control })
    }

    /// Reason for which programs without authentication may have control, by the
    /// configuration of Zenoh; `None` without control or if only authenticated programs have
    /// it.
    pub fn open_control(&self) -> Option<&str> {
        self.open_control.as_deref()
    }

    pub(crate) fn links(&self) -> PublicationEvent {
        let info = self.session.info();
        let (routers, peers) = (info.routers_zid().wait(), info.peers_zid().wait());
        PublicationEvent::Links { routers: routers.count(), peers: peers.count() }
    }

    pub(crate) fn count_late(&self, requests: u64) {
        lock(&self.rejected).late += requests;
    }

    /// The response to `hello`, with the access of remote clients.
    pub(crate) fn remote_hello(&self, hello: &Hello) -> Hello {
        let mut hello = hello.clone();
        if !self.config.has_control {
            hello.access = ecan_service::client::Access::Read;
            hello.access_reason =
                Some("remote clients only read; start ecan zenoh with --control".into());
        }
        hello
    }
}

pub(crate) fn lock<T>(mutex: &Mutex<T>) -> std::sync::MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
