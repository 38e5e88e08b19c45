//! A client's line: bytes both ways, which another thread can end.

use std::io::{self, Read as _, Write as _};
use std::net::{Shutdown, TcpStream};
use std::sync::Arc;
use std::time::Duration;

use rustix::net::sockopt;

use crate::terminal::TerminalLine;

/// A client whose machine has not acknowledged anything for so long is gone. One that merely does not
/// read is so too, once the buffers of both machines are full.
const SILENCE_MS: u32 = 60_000;
/// Without traffic, between two questions whether the client's machine is there.
const QUESTION_INTERVAL: Duration = Duration::from_secs(10);

/// Makes a connection end when the machine at its other end is gone without a word: it would keep the
/// place of another client for ever.
pub(crate) fn watch(stream: &TcpStream) -> io::Result<()> {
    sockopt::set_socket_keepalive(stream, true)?;
    sockopt::set_tcp_keepidle(stream, QUESTION_INTERVAL)?;
    sockopt::set_tcp_keepintvl(stream, QUESTION_INTERVAL)?;
    // Ends it while something is on its way, too, and takes the place of a number of questions.
    Ok(sockopt::set_tcp_user_timeout(stream, SILENCE_MS)?)
}

/// What ends a client.
pub(crate) trait Close: std::fmt::Debug + Send {
    /// Ends it; all of its threads notice. One that is gone already is no error.
    fn close(&self);
}

/// A connection; clones are the same one.
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

    /// Waits for bytes; none at the end.
    pub(crate) fn read(&self, bytes: &mut [u8]) -> io::Result<usize> {
        match self {
            Self::Tcp(stream) => {
                let mut stream = stream;
                stream.read(bytes)
            }
            Self::Terminal(line) => line.read(bytes),
        }
    }

    /// Waits until all bytes are taken.
    pub(crate) fn write_all(&self, bytes: &[u8]) -> io::Result<()> {
        match self {
            Self::Tcp(stream) => {
                let mut stream = stream;
                stream.write_all(bytes)
            }
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

    /// A machine that vanishes cannot be had here; what the system is asked for can be read back.
    #[test]
    fn a_connection_is_asked_whether_it_is_there() {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let _client = TcpStream::connect(listener.local_addr().unwrap()).unwrap();
        let (stream, _) = listener.accept().unwrap();
        watch(&stream).unwrap();
        assert!(sockopt::socket_keepalive(&stream).unwrap());
        assert_eq!(sockopt::tcp_keepidle(&stream).unwrap(), QUESTION_INTERVAL);
        assert_eq!(sockopt::tcp_user_timeout(&stream).unwrap(), SILENCE_MS);
    }
}
