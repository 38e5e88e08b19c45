//! The publication of a service.

use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, SystemTime};

use ecan_protocol::text::Printable;
use ecan_service::client::{ClientError, Hello};
use serde_json::Value;
use thiserror::Error;
use zenoh::{Config, Session, Wait as _};

use crate::client_counts::{ClientCounts, RejectedRequests};
use crate::frame_batches::FrameBatches;
use crate::keys::Keys;
use crate::transmit_limits::TransmitLimits;

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
    /// Interval of the states. A change of state is published at once.
    pub interval: Duration,
    /// Time that the first frame of a publication waits for further ones; 0 publishes each at once.
    pub gather: Duration,
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
    /// A remote client with this name has made its first request.
    Client(String),
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
            Self::Client(name) => write!(f, "zenoh: client {}", Printable(name)),
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
    pub(crate) clients: Arc<Mutex<ClientCounts>>,
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
        let (zenoh_config, open_control) = read(file)?;
        let session = zenoh::open(zenoh_config).wait();
        let session = session.map_err(|error| PublicationError::open(&error))?;
        let epoch = SystemTime::UNIX_EPOCH.elapsed().unwrap_or_default().as_nanos();
        let batches = FrameBatches::new(u64::try_from(epoch).unwrap_or_default());
        let (batches, rejected) = (Arc::new(Mutex::new(batches)), Arc::default());
        let clients = Arc::default();
        let open_control = open_control.filter(|_| config.has_control);
        Ok(Self { session, config, batches, rejected, clients, open_control })
    }

    /// Reason for which programs without authentication may have control, by the
    /// configuration of Zenoh; `None` without control or if only authenticated programs have
    /// it.
    pub fn open_control(&self) -> Option<&str> {
        self.open_control.as_deref()
    }

    /// Counters of the publisher and of its remote clients, in the text form of Prometheus (0.0.4).
    pub fn metrics(&self) -> String {
        let rejected = *lock(&self.rejected);
        let batches = lock(&self.batches);
        lock(&self.clients).metrics(&batches, rejected)
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
    /// The name of a remote client is not allowed.
    #[error("{}", Printable(reason))]
    ClientName {
        /// Value and what is allowed.
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
    pub(crate) fn open(error: &zenoh::Error) -> Self {
        Self::Open { reason: text_of(error) }
    }

    pub(crate) fn session<E: std::fmt::Display>(
        action: &'static str,
        key: &str,
    ) -> impl FnOnce(E) -> Self {
        move |error| Self::Session { action, key: key.to_owned(), reason: error.to_string() }
    }
}

/// Text of an error of Zenoh without the places in its source.
fn text_of(error: &zenoh::Error) -> String {
    let text = error.to_string();
    let message = text.split(" at /").next().unwrap_or_default();
    message.trim_end_matches(|end: char| end.is_whitespace() || end == '!').to_owned()
}

/// Bytes of a received message without a setting. A request that is too long for the service gets an
/// error; Zenoh discards a longer message. The default of Zenoh is 1 GiB.
const MAX_MESSAGE_BYTES: &str = "1048576";

/// Reads a configuration file of Zenoh, and the reason for which programs without authentication
/// have control with it. What the file does not set has the default of Zenoh, except that nothing
/// listens, multicast scouting is off and received messages have at most [`MAX_MESSAGE_BYTES`].
pub(crate) fn read(path: &Path) -> Result<(Config, Option<String>), PublicationError> {
    let failed = |reason: String| PublicationError::ConfigFile { path: path.to_owned(), reason };
    let text = std::fs::read_to_string(path).map_err(|error| failed(error.to_string()))?;
    let value: Value = json5::from_str(&text).map_err(|error| failed(error.to_string()))?;
    let mut config = Config::from_json5(&text).map_err(|error| failed(error.to_string()))?;
    let listens = value.pointer("/listen/endpoints");
    let multicast = value.pointer("/scouting/multicast/enabled");
    let mut set =
        |key, value| config.insert_json5(key, value).map_err(|error| failed(error.to_string()));
    if listens.is_none() {
        set("listen/endpoints", "[]")?;
    }
    if multicast.is_none() {
        set("scouting/multicast/enabled", "false")?;
    }
    if value.pointer("/transport/link/rx/max_message_size").is_none() {
        set("transport/link/rx/max_message_size", MAX_MESSAGE_BYTES)?;
    }
    let mut endpoints = Vec::new();
    for key in ["/listen/endpoints", "/connect/endpoints"] {
        value.pointer(key).into_iter().for_each(|found| collect_texts(found, &mut endpoints));
    }
    if !endpoints.is_empty() || multicast == Some(&true.into()) {
        Ok((config, open_control(&value, &endpoints)))
    } else {
        Err(PublicationError::NoEndpoint { path: path.to_owned() })
    }
}

/// Endpoints are a list, or a list for each mode.
fn collect_texts<'a>(value: &'a Value, texts: &mut Vec<&'a str>) {
    match value {
        Value::String(text) => texts.push(text),
        Value::Array(values) => values.iter().for_each(|value| collect_texts(value, texts)),
        Value::Object(modes) => modes.values().for_each(|value| collect_texts(value, texts)),
        _ => {}
    }
}

/// Reason for which programs without authentication may have control. A router between the hosts
/// has a configuration of its own, which this one does not show.
fn open_control(value: &Value, endpoints: &[&str]) -> Option<String> {
    let is = |key, expected: Value| value.pointer(key) == Some(&expected);
    let mut reasons = Vec::new();
    let has_mutual_tls = is("/transport/link/tls/enable_mtls", true.into())
        && endpoints
            .iter()
            .all(|endpoint| endpoint.starts_with("tls/") || endpoint.starts_with("quic/"));
    let passwords = ["/transport/auth/usrpwd/dictionary_file", "/transport/auth/usrpwd/user"];
    let has_password = passwords.iter().any(|key| value.pointer(key).is_some_and(Value::is_string));
    if !has_mutual_tls && !has_password {
        reasons.push("links without authentication (transport.link.tls.enable_mtls)");
    }
    if !is("/access_control/enabled", true.into()) {
        reasons.push("access_control is off");
    } else if is("/access_control/default_permission", "allow".into()) {
        reasons.push("access_control.default_permission is \"allow\"");
    }
    (!reasons.is_empty()).then(|| reasons.join(", "))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn config(text: &str) -> Result<Config, PublicationError> {
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), text).unwrap();
        read(file.path()).map(|(config, _)| config)
    }

    #[test]
    fn open_control_is_found_with_its_reason() {
        let reason = |text: &str| {
            let value: Value = json5::from_str(text).unwrap();
            let mut endpoints = Vec::new();
            collect_texts(&value["listen"]["endpoints"], &mut endpoints);
            open_control(&value, &endpoints).unwrap_or_default()
        };
        let acl = "access_control: { enabled: true, default_permission: 'deny' }";
        let tls = "transport: { link: { tls: { enable_mtls: true } } }";
        let password = "transport: { auth: { usrpwd: { dictionary_file: 'users' } } }";
        let [tcp, secured] =
            ["tcp", "tls"].map(|link| format!("listen: {{ endpoints: ['{link}/a:1'] }}"));
        let by_mode = "listen: { endpoints: { router: ['tls/a:1'], peer: ['tcp/a:1'] } }";
        for (text, words) in [
            (
                format!("{{ {tcp} }}"),
                "links without authentication (transport.link.tls.enable_mtls), \
                                      access_control is off",
            ),
            (format!("{{ {secured}, {tls} }}"), "access_control is off"),
            (format!("{{ {secured}, {acl} }}"), "links without authentication"),
            (format!("{{ {tcp}, {tls}, {acl} }}"), "links without authentication"),
            (format!("{{ {by_mode}, {tls}, {acl} }}"), "links without authentication"),
            (format!("{{ {secured}, {tls}, {acl} }}").replace("deny", "allow"), "is \"allow\""),
        ] {
            assert!(reason(&text).contains(words), "{text}: {}", reason(&text));
        }
        for text in
            [format!("{{ {secured}, {tls}, {acl} }}"), format!("{{ {tcp}, {password}, {acl} }}")]
        {
            assert_eq!(reason(&text), "");
        }
    }

    #[test]
    fn received_messages_are_bounded() {
        let size = |settings: &str| {
            let text = format!("{{ connect: {{ endpoints: ['tcp/a:1'] }}, {settings} }}");
            config(&text).unwrap().get_json("transport/link/rx/max_message_size").unwrap()
        };
        assert_eq!(size(""), MAX_MESSAGE_BYTES);
        assert_eq!(size("transport: { link: { rx: { max_message_size: 9000000 } } }"), "9000000");
    }

    fn network(config: &Config) -> [String; 2] {
        ["listen/endpoints", "scouting/multicast/enabled"].map(|key| config.get_json(key).unwrap())
    }

    #[test]
    fn nothing_listens_unless_configured() {
        let silent = config("{ connect: { endpoints: ['tcp/10.0.0.1:7447'] } }").unwrap();
        assert_eq!(network(&silent), ["[]", "false"]);
        let listening = config("{ listen: { endpoints: ['tcp/127.0.0.1:7447'] } }").unwrap();
        assert_eq!(network(&listening), ["[\"tcp/127.0.0.1:7447\"]", "false"]);
        let scouting = config("{ scouting: { multicast: { enabled: true } } }").unwrap();
        assert_eq!(network(&scouting), ["[]", "true"]);
    }

    #[test]
    fn other_settings_are_unchanged() {
        let text = "{ mode: 'client', connect: { endpoints: ['tls/a:1'] }, \
                    access_control: { enabled: true, default_permission: 'deny' } }";
        let config = config(text).unwrap();
        assert_eq!(config.get_json("mode").unwrap(), "\"client\"");
        assert_eq!(config.get_json("access_control/default_permission").unwrap(), "\"deny\"");
    }

    #[test]
    fn wrong_files_are_rejected_with_the_reason() {
        for (text, words) in [
            ("{", "expected"),
            ("{ no_such_key: 1 }", "no_such_key"),
            ("{ mode: 'fast' }", "fast"),
            ("{}", "permits no connection"),
            ("{ connect: { endpoints: [] } }", "permits no connection"),
        ] {
            let error = config(text).unwrap_err().to_string();
            assert!(error.contains(words), "{text}: {error}");
        }
        let error = read(Path::new("/none/\u{1b}[2J.json5")).unwrap_err().to_string();
        assert!(error.contains(r"/none/\x1b[2J.json5: No such file"), "{error}");
    }
}
