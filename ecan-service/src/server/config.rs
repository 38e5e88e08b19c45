//! Configuration of a service, the methods that a program adds to it, and the errors of its start.

use std::net::SocketAddr;
use std::os::unix::net::UnixListener;
use std::path::PathBuf;
use std::str::FromStr;
use std::sync::Arc;
use std::time::Duration;
use std::{fmt, io};

use ecan_protocol::text::Printable;
use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::Value;
use thiserror::Error;

use crate::protocol::{Access, INTERNAL_ERROR, INVALID_PARAMS, RpcError};

/// Clients with control: they send frames, download SDOs and call the controlling methods of
/// extensions. All other clients that may open the socket only read.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub enum Control {
    /// No client.
    #[default]
    Nobody,
    /// The user of the service, and root.
    Owner,
    /// Members of a group, the user of the service, and root.
    Group(String),
    /// Every client.
    Everyone,
}

/// Configuration of a [`Service`](crate::server::Service).
#[derive(Debug)]
pub struct ServiceConfig {
    /// Path of the socket. The service creates its directory, but not the directories above.
    pub path: PathBuf,
    /// Permissions of the socket; 0o660 by default. Clients need write permission.
    pub mode: u32,
    /// Group of the socket; `None` for that of the process.
    pub group: Option<String>,
    /// Clients with control; by default none.
    pub control: Control,
    /// Most clients at a time; 64 by default. The last place is for root and the user of the service;
    /// each other user has at most half of the places.
    pub max_clients: usize,
    /// Bytes of frames and images that wait for one client; 1 MiB by default. A client that reads too
    /// slowly loses what exceeds it.
    pub queue_bytes: usize,
    /// Bytes of the ring between the cycle and the service; 4 MiB by default.
    pub ring_bytes: usize,
    /// Frames of one client and channel that may be without result; 64 by default.
    pub window: u32,
    /// Name of the program, for clients and messages.
    pub name: String,
    /// Version of the program, for clients.
    pub version: String,
    /// Methods of the program.
    pub extensions: Vec<Arc<dyn Extension>>,
    /// A socket that listens already, for example one of systemd. Its file and permissions are not the
    /// service's; `path` is for messages only.
    pub listener: Option<UnixListener>,
    /// Metrics for Prometheus; by default none.
    pub metrics: Option<MetricsConfig>,
}

impl ServiceConfig {
    /// Creates a read-only service at `path`, with the defaults above.
    pub fn new(path: impl Into<PathBuf>) -> Self {
        Self {
            path: path.into(),
            mode: 0o660,
            group: None,
            control: Control::Nobody,
            max_clients: 64,
            queue_bytes: 1 << 20,
            ring_bytes: 4 << 20,
            window: 64,
            name: "application".into(),
            version: env!("CARGO_PKG_VERSION").into(),
            extensions: Vec::new(),
            listener: None,
            metrics: None,
        }
    }

    /// Sets the clients with control.
    #[must_use]
    pub fn with_control(mut self, control: Control) -> Self {
        self.control = control;
        self
    }

    /// Sets name and version of the program.
    #[must_use]
    pub fn with_name(mut self, name: impl Into<String>, version: impl Into<String>) -> Self {
        (self.name, self.version) = (name.into(), version.into());
        self
    }

    /// Adds methods of the program.
    #[must_use]
    pub fn with_extension(mut self, extension: impl Extension + 'static) -> Self {
        self.extensions.push(Arc::new(extension));
        self
    }

    /// Serves metrics, on a thread of their own.
    #[must_use]
    pub fn with_metrics(mut self, metrics: MetricsConfig) -> Self {
        self.metrics = Some(metrics);
        self
    }
}

/// Longest path of the socket, in bytes: 107 (`sun_path` without its terminating 0), less the suffix of
/// its random name before it is moved to the path.
pub(crate) const MAX_SOCKET_PATH: usize = 99;

/// Error of the start of a service.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum ServiceError {
    /// Another service listens at the path.
    #[error(
        "socket {} is in use by {}; stop that service or set another path",
        Printable(path.display()), Process(*pid)
    )]
    InUse {
        /// Path of the socket.
        path: PathBuf,
        /// Process that listens, if the system names it.
        pid: Option<u32>,
    },
    /// A file at the path is not a socket.
    #[error("{} is not a socket; remove it or set another path", Printable(path.display()))]
    NotSocket {
        /// The path.
        path: PathBuf,
    },
    /// Linux does not allow longer paths of sockets.
    #[error(
        "socket path of {} bytes is too long: {}; allowed: at most {MAX_SOCKET_PATH}; set another path",
        path.as_os_str().len(), Printable(path.display())
    )]
    PathTooLong {
        /// The path.
        path: PathBuf,
    },
    /// The socket cannot be created.
    #[error("cannot create socket {}: {what}: {source}", Printable(path.display()))]
    Socket {
        /// Path of the socket.
        path: PathBuf,
        /// The step that failed.
        what: &'static str,
        /// Error of the system.
        source: io::Error,
    },
    /// No such group.
    #[error(
        "group \"{group}\" does not exist; create it (groupadd --system {group}) or set another group",
        group = Printable(.0)
    )]
    NoSuchGroup(String),
    /// The queue of a client is too small for one image.
    #[error("client queue of {0} bytes is out of range; allowed: at least 8192")]
    QueueBytes(usize),
    /// Other hosts reach the address of the metrics.
    #[error(
        "metrics address {0} is not a loopback address; allowed: 127.0.0.1, [::1] or unix:PATH; the \
         metrics have no access control, permit other hosts with allows_remote (--metrics-remote)"
    )]
    RemoteMetrics(SocketAddr),
    /// The address of the metrics cannot be used.
    #[error("cannot listen at metrics address {address}: {source}; {}", metrics_remedy(source))]
    MetricsAddress {
        /// The address.
        address: SocketAddr,
        /// Error of the system.
        source: io::Error,
    },
    /// The thread cannot be started.
    #[error("cannot start the service's thread: {0}")]
    Thread(io::Error),
}

/// Action after a failed listen at a TCP address.
fn metrics_remedy(source: &io::Error) -> &'static str {
    if source.raw_os_error() == Some(rustix::io::Errno::AFNOSUPPORT.raw_os_error()) {
        // The unit of `ecan serve` permits Unix sockets only.
        "a unit of systemd denies TCP by RestrictAddressFamilies: install the drop-in metrics-tcp.conf \
         (docs/SERVICE.md), or set unix:PATH"
    } else {
        "set another address"
    }
}

struct Process(Option<u32>);

impl fmt::Display for Process {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0 {
            Some(pid) => write!(f, "process {pid}"),
            None => f.write_str("another process"),
        }
    }
}

/// Methods that a program adds to its service, for example `reload`.
pub trait Extension: fmt::Debug + Send + Sync {
    /// Access that a method needs: `Control` if it changes something; `None` if the extension does not
    /// have it. Called on the thread of the service, which rejects clients without this access: it does not
    /// block.
    fn access(&self, method: &str) -> Option<Access>;

    /// Calls a method; `None` if the extension does not have it. Called on a worker thread of the
    /// service, at most two calls at a time and one of each client: it may block. `access` is that of the
    /// client.
    fn call(
        &self,
        method: &str,
        params: &Value,
        access: &Permission,
    ) -> Option<Result<Value, RpcError>>;
}

/// Access of a client, with the reason without control.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Permission {
    /// The access.
    pub access: Access,
    /// Reason without control.
    pub reason: Option<String>,
}

impl Permission {
    /// Rejects a client without control.
    ///
    /// # Errors
    /// An error with the code [`NOT_PERMITTED`](crate::protocol::NOT_PERMITTED), the method and
    /// the reason.
    pub fn need_control(&self, method: &str) -> Result<(), RpcError> {
        if self.access == Access::Control {
            return Ok(());
        }
        let reason = self.reason.as_deref().unwrap_or("the service is read-only");
        let text = format!("{method} is not permitted: {reason}");
        Err(RpcError::new(crate::protocol::NOT_PERMITTED, text))
    }
}

/// Parses the parameters of a method. Absent ones are those of a method without any.
///
/// # Errors
/// An error with the code [`INVALID_PARAMS`], the method and the cause.
pub fn parse_params<P: DeserializeOwned>(method: &str, params: &Value) -> Result<P, RpcError> {
    let params = match params {
        Value::Null => Value::Object(serde_json::Map::new()),
        params => params.clone(),
    };
    serde_json::from_value(params).map_err(|error| {
        RpcError::new(INVALID_PARAMS, format!("invalid parameters of {method}: {error}"))
    })
}

/// Converts the result of a method to JSON.
///
/// # Errors
/// An error with the code [`INTERNAL_ERROR`]: the result has no form in JSON.
pub fn result_value(result: &impl Serialize) -> Result<Value, RpcError> {
    serde_json::to_value(result).map_err(|error| RpcError::new(INTERNAL_ERROR, error.to_string()))
}

const UNIX_PREFIX: &str = "unix:";

/// Address at which metrics are served.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum MetricsAddress {
    /// A TCP address.
    Tcp(SocketAddr),
    /// Path of a Unix socket, with permissions and group of the service's socket.
    Unix(PathBuf),
}

/// Error of a text that is not an address of metrics.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error(
    "metrics address \"{}\" is not valid; allowed: a numeric address with its port (127.0.0.1:9464, \
     [::1]:9464) or unix:PATH",
    Printable(.0)
)]
pub struct MetricsAddressError(String);

impl FromStr for MetricsAddress {
    type Err = MetricsAddressError;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        match text.strip_prefix(UNIX_PREFIX) {
            Some("") => Err(MetricsAddressError(text.into())),
            Some(path) => Ok(Self::Unix(path.into())),
            None => text.parse().map(Self::Tcp).map_err(|_| MetricsAddressError(text.into())),
        }
    }
}

impl fmt::Display for MetricsAddress {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Tcp(address) => address.fmt(f),
            Self::Unix(path) => write!(f, "{UNIX_PREFIX}{}", Printable(path.display())),
        }
    }
}

/// Configuration of the metrics of a service, for
/// [`ServiceConfig::metrics`](crate::server::ServiceConfig::metrics).
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct MetricsConfig {
    /// Address. Every local user can read metrics at a TCP address.
    pub address: MetricsAddress,
    /// Permits a TCP address that other hosts reach. The metrics have neither access control nor
    /// encryption.
    pub allows_remote: bool,
    /// Interval in which error counters and counters of the data path (0x9000, 0x9020) of the enabled
    /// channels are read by SDO, up to 8 transfers per channel; `None`, the default, reads none.
    pub object_interval: Option<Duration>,
}

impl MetricsConfig {
    /// Metrics for this host only.
    pub const fn new(address: MetricsAddress) -> Self {
        Self { address, allows_remote: false, object_interval: None }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn denied_address_family_names_the_drop_in() {
        let text = |errno: rustix::io::Errno| {
            let address = "127.0.0.1:9464".parse().unwrap();
            ServiceError::MetricsAddress { address, source: errno.into() }.to_string()
        };
        let denied = text(rustix::io::Errno::AFNOSUPPORT);
        assert!(
            denied.contains("127.0.0.1:9464") && denied.contains("metrics-tcp.conf"),
            "{denied}"
        );
        assert!(text(rustix::io::Errno::ADDRINUSE).ends_with("; set another address"));
    }

    #[test]
    fn addresses_are_read_as_written() {
        for text in ["127.0.0.1:9464", "[::1]:0", "unix:/run/ecan/metrics.sock"] {
            assert_eq!(text.parse::<MetricsAddress>().unwrap().to_string(), text);
        }
        for text in ["", "unix:", "localhost:9464", "127.0.0.1", "/run/ecan/metrics.sock"] {
            let error = text.parse::<MetricsAddress>().unwrap_err().to_string();
            assert!(error.contains(&format!("\"{text}\" is not valid; allowed")), "{error}");
        }
    }

    #[test]
    fn controls_in_addresses_are_escaped() {
        let error = "\u{1b}[2J".parse::<MetricsAddress>().unwrap_err().to_string();
        assert!(error.contains(r#""\x1b[2J" is not valid"#), "{error}");
        let address: MetricsAddress = "unix:/run/\u{9b}2J\n".parse().unwrap();
        assert_eq!(address.to_string(), r"unix:/run/\x9b2J\n");
    }
}
