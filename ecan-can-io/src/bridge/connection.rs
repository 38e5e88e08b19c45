//! Connection to a client; another thread can end it.

use std::io::{self, Read as _, Write as _};
use std::net::{IpAddr, Shutdown, TcpStream};
use std::sync::Arc;
use std::time::Duration;

use rustix::net::sockopt;

use crate::bridge::terminal::TerminalLine;

/// Time without acknowledgement after which a client's machine counts as lost. The same applies to
/// a client that does not read, once the buffers of both machines are full.
const SILENCE_MS: u32 = 60_000;
const KEEP_ALIVE_INTERVAL: Duration = Duration::from_secs(10);

/// Ends a connection whose peer machine vanished; otherwise it would occupy the place of another
/// client forever.
pub(crate) fn watch(stream: &TcpStream) -> io::Result<()> {
    sockopt::set_socket_keepalive(stream, true)?;
    sockopt::set_tcp_keepidle(stream, KEEP_ALIVE_INTERVAL)?;
    sockopt::set_tcp_keepintvl(stream, KEEP_ALIVE_INTERVAL)?;
    // Also ends it while data are in transit, and replaces the number of probes.
    Ok(sockopt::set_tcp_user_timeout(stream, SILENCE_MS)?)
}

/// Handle that ends a client's connection.
pub(crate) trait Close: std::fmt::Debug + Send {
    /// Ends the connection; all of its threads notice. No effect if it has already ended.
    fn close(&self);
}

/// A connection; a clone refers to the same one.
#[derive(Debug)]
pub(crate) enum Connection {
    Tcp(TcpStream),
    Terminal(Arc<TerminalLine>),
}

impl Connection {
    pub(crate) fn try_clone(&self) -> io::Result<Self> {
        Ok(match self {
            Self::Tcp(stream) => Self::Tcp(stream.try_clone()?),
            Self::Terminal(line) => Self::Terminal(line.clone()),
        })
    }

    /// Waits for bytes; returns 0 at the end.
    pub(crate) fn read(&self, bytes: &mut [u8]) -> io::Result<usize> {
        match self {
            Self::Tcp(stream) => (&*stream).read(bytes),
            Self::Terminal(line) => line.read(bytes),
        }
    }

    /// Limits the time of the following calls of [`read`](Self::read). A terminal has no limit.
    pub(crate) fn set_read_limit(&self, limit: Option<Duration>) -> io::Result<()> {
        match self {
            Self::Tcp(stream) => stream.set_read_timeout(limit),
            Self::Terminal(_) => Ok(()),
        }
    }

    /// Address of the client's machine.
    pub(crate) fn peer(&self) -> Option<IpAddr> {
        match self {
            Self::Tcp(stream) => stream.peer_addr().ok().map(|address| address.ip()),
            Self::Terminal(_) => None,
        }
    }

    pub(crate) fn write_all(&self, bytes: &[u8]) -> io::Result<()> {
        match self {
            Self::Tcp(stream) => (&*stream).write_all(bytes),
            Self::Terminal(line) => line.write_all(bytes),
        }
    }
}

impl Close for Connection {
    fn close(&self) {
        match self {
            Self::Tcp(stream) => {
                let _ = stream.shutdown(Shutdown::Both);
            }
            Self::Terminal(line) => line.close(),
        }
    }
}

#[cfg(test)]
mod tests {
    use std::net::TcpListener;

    use super::*;

    /// A vanished machine cannot be simulated here; the socket options can be read back.
    #[test]
    fn connection_has_keep_alive() {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let _client = TcpStream::connect(listener.local_addr().unwrap()).unwrap();
        let (stream, _) = listener.accept().unwrap();
        watch(&stream).unwrap();
        assert!(sockopt::socket_keepalive(&stream).unwrap());
        assert_eq!(sockopt::tcp_keepidle(&stream).unwrap(), KEEP_ALIVE_INTERVAL);
        assert_eq!(sockopt::tcp_user_timeout(&stream).unwrap(), SILENCE_MS);
    }
}
