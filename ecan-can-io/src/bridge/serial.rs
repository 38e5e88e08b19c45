//! slcan on a pseudo-terminal.

use super::client_queue::ClientQueue;
use super::clients::Clients;
use super::server::{BridgeProtocol, Connection, serve};
use super::session::Session;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fs::{OFlags, fcntl_setfl};
use rustix::io::Errno;
use rustix::pty::{OpenptFlags, grantpt, ioctl_tiocgptpeer, openpt, ptsname, unlockpt};
use rustix::termios::{OptionalActions, QueueSelector, tcflush, tcgetattr, tcsetattr};
use std::ffi::OsString;
use std::os::fd::OwnedFd;
use std::os::unix::ffi::OsStringExt as _;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;
use std::{io, thread};

/// Interval of polling for a program. Stopping does not wait for it.
const LOOK_INTERVAL: Duration = Duration::from_millis(10);

/// A pseudo-terminal that behaves as an slcan adapter with one client: the program that has it
/// open. The next program gets a new session. Dropping it ends its thread.
#[derive(Debug)]
pub struct SerialBridge {
    terminal: Arc<Terminal>,
    clients: Arc<Clients>,
    thread: Option<JoinHandle<()>>,
}

impl SerialBridge {
    /// Creates the terminal; `queue` is the capacity in frames of the queue to the bus and of the
    /// queue to the client.
    ///
    /// # Errors
    /// No pseudo-terminal or no thread is available.
    pub fn open(queue: usize) -> io::Result<Self> {
        let terminal = Arc::new(Terminal::open()?);
        let clients = Arc::new(Clients::new(queue, 1));
        let (line, served) = (terminal.clone(), clients.clone());
        let thread = thread::Builder::new()
            .name("bridge terminal".to_owned())
            .spawn(move || serve_programs(&served, &line))?;
        Ok(Self { terminal, clients, thread: Some(thread) })
    }

    /// Path that other programs open.
    pub fn path(&self) -> &Path {
        self.terminal.path()
    }

    /// The client.
    pub fn clients(&self) -> &Arc<Clients> {
        &self.clients
    }
}

impl Drop for SerialBridge {
    fn drop(&mut self) {
        self.clients.close();
        if let Some(thread) = self.thread.take() {
            thread.thread().unpark();
            // A panic in it has been reported on stderr already.
            let _ = thread.join();
        }
    }
}

/// Serves one program after the other until the bridge is closed.
fn serve_programs(clients: &Clients, terminal: &Arc<Terminal>) {
    while !clients.is_closed() {
        // A terminal that cannot be polled counts as unused.
        if !terminal.is_in_use().unwrap_or(false) {
            thread::park_timeout(LOOK_INTERVAL);
            continue;
        }
        let line = Arc::new(TerminalLine::new(terminal.clone()));
        let queue = Arc::new(ClientQueue::new(clients.queue()));
        // If the client is not admitted, the bridge was closed just now.
        let connection = Connection::Terminal(line.clone());
        let Some(id) = clients.join(connection, None, queue.clone()) else {
            return;
        };
        let session = Session::new(BridgeProtocol::Slcan);
        serve(clients, id, &Connection::Terminal(line), session, &queue, None);
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
