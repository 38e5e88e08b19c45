//! A client's line: bytes both ways, which another thread can end.

use std::io::{self, Read as _, Write as _};
use std::net::{Shutdown, TcpStream};
use std::sync::Arc;

use crate::terminal::Terminal;

/// What ends a client.
pub(crate) trait Close: std::fmt::Debug + Send {
    /// Ends it; all of its threads notice. One that is gone already is no error.
    fn close(&self);
}

/// A connection; clones are the same one.
#[derive(Debug)]
pub(crate) enum Connection {
    Tcp(TcpStream),
    Terminal(Arc<Terminal>),
}

impl Connection {
    pub(crate) fn try_clone(&self) -> io::Result<Self> {
        Ok(match self {
            Self::Tcp(stream) => Self::Tcp(stream.try_clone()?),
            Self::Terminal(terminal) => Self::Terminal(terminal.clone()),
        })
    }

    /// Waits for bytes; none at the end.
    pub(crate) fn read(&self, bytes: &mut [u8]) -> io::Result<usize> {
        match self {
            Self::Tcp(stream) => {
                let mut stream = stream;
                stream.read(bytes)
            }
            Self::Terminal(terminal) => terminal.read(bytes),
        }
    }

    /// Waits until all bytes are taken.
    pub(crate) fn write_all(&self, bytes: &[u8]) -> io::Result<()> {
        match self {
            Self::Tcp(stream) => {
                let mut stream = stream;
                stream.write_all(bytes)
            }
            Self::Terminal(terminal) => terminal.write_all(bytes),
        }
    }
}

impl Close for Connection {
    fn close(&self) {
        match self {
            Self::Tcp(stream) => {
                let _ = stream.shutdown(Shutdown::Both);
            }
            Self::Terminal(terminal) => terminal.close(),
        }
    }
}
