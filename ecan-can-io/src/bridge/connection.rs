//! Connection to a client over TCP or a pseudo-terminal; another thread can end it.

use std::ffi::OsString;
use std::io;
use std::io::{Read as _, Write as _};
use std::net::{IpAddr, Shutdown, TcpStream};
use std::os::fd::OwnedFd;
use std::os::unix::ffi::OsStringExt as _;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fs::{OFlags, fcntl_setfl};
use rustix::io::Errno;
use rustix::net::sockopt;
use rustix::pty::{OpenptFlags, grantpt, ioctl_tiocgptpeer, openpt, ptsname, unlockpt};
use rustix::termios::{OptionalActions, QueueSelector, tcflush, tcgetattr, tcsetattr};

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
            Self::Tcp(stream) => {
                let read = (&*stream).read(bytes);
                // A client that sends small messages waits for the acknowledgement of each (Nagle's algorithm), which
                // Linux would delay by 40 ms. The option ends with each read.
                let _ = rustix::net::sockopt::set_tcp_quickack(stream, true);
                read
            }
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

const LOOK: Timespec = Timespec { tv_sec: 0, tv_nsec: 50_000_000 };
const AT_ONCE: Timespec = Timespec { tv_sec: 0, tv_nsec: 0 };

/// The bridge's side of a pseudo-terminal. The other side is open only while a program has it open,
/// so that its end is detected.
#[derive(Debug)]
pub(crate) struct Terminal {
    ours: OwnedFd,
    path: PathBuf,
}

impl Terminal {
    /// Opens a terminal in raw mode.
    pub(crate) fn open() -> io::Result<Self> {
        let ours = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC)?;
        grantpt(&ours)?;
        unlockpt(&ours)?;
        let path = PathBuf::from(OsString::from_vec(ptsname(&ours, Vec::new())?.into_bytes()));
        fcntl_setfl(&ours, OFlags::RDWR | OFlags::NONBLOCK)?;
        let terminal = Self { ours, path };
        set_raw(&terminal.theirs()?)?;
        Ok(terminal)
    }

    pub(crate) fn path(&self) -> &Path {
        &self.path
    }

    /// Opens the other side.
    fn theirs(&self) -> io::Result<OwnedFd> {
        let flags = OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC;
        Ok(ioctl_tiocgptpeer(&self.ours, flags)?)
    }

    fn is_open(&self) -> io::Result<bool> {
        self.poll_at_once().map(|found| !found.contains(PollFlags::HUP))
    }

    /// Returns whether a program has it open, or has left unread input.
    pub(crate) fn is_in_use(&self) -> io::Result<bool> {
        let found = self.poll_at_once()?;
        Ok(!found.contains(PollFlags::HUP) || found.contains(PollFlags::IN))
    }

    fn poll_at_once(&self) -> io::Result<PollFlags> {
        let mut polled = [PollFd::new(&self.ours, PollFlags::IN)];
        rustix::io::retry_on_intr(|| poll(&mut polled, Some(&AT_ONCE)))?;
        let [polled] = polled;
        Ok(polled.revents())
    }

    /// Resets the terminal for the next program: raw mode, no unread input.
    fn renew(&self) -> io::Result<()> {
        let is_open = self.is_open()?;
        let theirs = self.theirs()?;
        // Discards output and input.
        tcflush(&self.ours, QueueSelector::OFlush)?;
        tcflush(&theirs, QueueSelector::IFlush)?;
        // The next program may already have changed the settings.
        if is_open { Ok(()) } else { set_raw(&theirs) }
    }
}

fn set_raw(theirs: &OwnedFd) -> io::Result<()> {
    let mut modes = tcgetattr(theirs)?;
    modes.make_raw();
    Ok(tcsetattr(theirs, OptionalActions::Now, &modes)?)
}

/// A terminal from the time a program opens it until no program has it open.
#[derive(Debug)]
pub(crate) struct TerminalLine {
    terminal: Arc<Terminal>,
    is_closed: AtomicBool,
    /// Locked for writing and for the reset: no old text can follow the reset.
    writing: Mutex<()>,
}

impl TerminalLine {
    pub(crate) fn new(terminal: Arc<Terminal>) -> Self {
        Self { terminal, is_closed: AtomicBool::new(false), writing: Mutex::default() }
    }

    pub(crate) fn close(&self) {
        self.is_closed.store(true, Ordering::Release);
    }

    pub(crate) fn read(&self, bytes: &mut [u8]) -> io::Result<usize> {
        loop {
            match rustix::io::read(&self.terminal.ours, &mut *bytes) {
                Ok(count) => return Ok(count),
                // No program has it open, and all input has been read.
                Err(Errno::IO) => return self.end(),
                Err(Errno::AGAIN) if !self.wait_for(PollFlags::IN)? => return Ok(0),
                Err(Errno::AGAIN | Errno::INTR) => {}
                Err(error) => return Err(error.into()),
            }
        }
    }

    /// The program has gone: resets the terminal before anyone is notified.
    fn end(&self) -> io::Result<usize> {
        let _turn = self.writing.lock().unwrap_or_else(PoisonError::into_inner);
        self.close();
        self.terminal.renew()?;
        Ok(0)
    }

    fn write(&self, bytes: &[u8]) -> Result<usize, Errno> {
        let _turn = self.writing.lock().unwrap_or_else(PoisonError::into_inner);
        let is_closed = self.is_closed.load(Ordering::Acquire);
        if is_closed { Err(Errno::IO) } else { rustix::io::write(&self.terminal.ours, bytes) }
    }

    pub(crate) fn write_all(&self, mut bytes: &[u8]) -> io::Result<()> {
        while !bytes.is_empty() {
            match self.write(bytes) {
                Ok(count) => bytes = bytes.get(count..).unwrap_or_default(),
                Err(Errno::AGAIN) if !self.wait_for(PollFlags::OUT)? => {
                    return Err(io::ErrorKind::ConnectionAborted.into());
                }
                Err(Errno::AGAIN | Errno::INTR) => {}
                Err(error) => return Err(error.into()),
            }
        }
        Ok(())
    }

    /// Waits a short time, at most until the terminal is ready; returns false once closed.
    fn wait_for(&self, flags: PollFlags) -> io::Result<bool> {
        match poll(&mut [PollFd::new(&self.terminal.ours, flags)], Some(&LOOK)) {
            Ok(_) | Err(Errno::INTR) => Ok(!self.is_closed.load(Ordering::Acquire)),
            Err(error) => Err(error.into()),
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
