//! A client's line: bytes both ways, which another thread can end.

use std::io::{self, Read as _, Write as _};
use std::net::{Shutdown, TcpStream};
use std::sync::Arc;

use crate::terminal::TerminalLine;

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

    /// Ends it; both of its threads notice. One that is gone already is no error.
    pub(crate) fn close(&self) {
        match self {
            Self::Tcp(stream) => {
                let _ = stream.shutdown(Shutdown::Both);
            }
            Self::Terminal(line) => line.close(),
        }
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
