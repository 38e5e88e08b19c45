//! Errors of the publication.

use std::path::PathBuf;

use ecan_protocol::text::Printable;
use ecan_service::client::ClientError;
use thiserror::Error;

/// Error of a publication.
#[derive(Debug, Clone, Error)]
#[non_exhaustive]
pub enum PublicationError {
    /// The configuration file of Zenoh cannot be read, or is not one.
    #[error("cannot read the Zenoh configuration {}: {}", Printable(path.display()), Printable(reason))]
    ConfigFile {
        /// The file.
        path: PathBuf,
        /// Cause.
        reason: String,
    },
    /// The configuration permits no connection.
    #[error(
        "Zenoh configuration {} permits no connection; set connect.endpoints or listen.endpoints, for \
         example [\"tcp/router:7447\"], or enable scouting.multicast",
        Printable(path.display())
    )]
    NoEndpoint {
        /// The file.
        path: PathBuf,
    },
    /// The session does not open: a router cannot be reached, an address is in use, a certificate
    /// is wrong.
    #[error(
        "cannot open the Zenoh session: {}; check the Zenoh configuration and its routers",
        Printable(reason)
    )]
    Open {
        /// Text of Zenoh.
        reason: String,
    },
    /// A call of the session failed.
    #[error("cannot {action} {} in Zenoh: {}", Printable(key), Printable(reason))]
    Session {
        /// What failed, for example "publish".
        action: &'static str,
        /// The key expression.
        key: String,
        /// Text of Zenoh.
        reason: String,
    },
    /// The service cannot be connected, or the connection ended.
    #[error(transparent)]
    Service(#[from] ClientError),
}

impl PublicationError {
    pub(crate) fn session<E: std::fmt::Display>(
        action: &'static str,
        key: &str,
    ) -> impl FnOnce(E) -> Self {
        move |error| Self::Session { action, key: key.to_owned(), reason: error.to_string() }
    }
}
