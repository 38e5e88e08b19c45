//! Configuration of the metrics.

use std::fmt;
use std::net::SocketAddr;
use std::path::PathBuf;
use std::str::FromStr;
use std::time::Duration;

use ecan_protocol::text::Printable;
use thiserror::Error;

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
