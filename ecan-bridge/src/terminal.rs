//! A pseudo-terminal: the serial port of an adapter that is not there.

use std::ffi::OsString;
use std::io;
use std::os::fd::OwnedFd;
use std::os::unix::ffi::OsStringExt as _;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fs::{OFlags, fcntl_setfl};
use rustix::io::Errno;
use rustix::pty::{OpenptFlags, grantpt, ioctl_tiocgptpeer, openpt, ptsname, unlockpt};
use rustix::termios::{OptionalActions, tcgetattr, tcsetattr};

/// Between two looks whether to end.
const LOOK: Timespec = Timespec { tv_sec: 0, tv_nsec: 50_000_000 };

/// Our side of a pseudo-terminal.
#[derive(Debug)]
pub(crate) struct Terminal {
    ours: OwnedFd,
    /// Held open, so that the line is not hung up between two programs that use it.
    _theirs: OwnedFd,
    path: PathBuf,
    is_closed: AtomicBool,
}

impl Terminal {
    /// Opens one in raw mode: bytes pass as they are.
    pub(crate) fn open() -> io::Result<Self> {
        let flags = OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC;
        let ours = openpt(flags)?;
        grantpt(&ours)?;
        unlockpt(&ours)?;
        let path = PathBuf::from(OsString::from_vec(ptsname(&ours, Vec::new())?.into_bytes()));
        let theirs = ioctl_tiocgptpeer(&ours, flags)?;
        let mut modes = tcgetattr(&theirs)?;
        modes.make_raw();
        tcsetattr(&theirs, OptionalActions::Now, &modes)?;
        fcntl_setfl(&ours, OFlags::RDWR | OFlags::NONBLOCK)?;
        Ok(Self { ours, _theirs: theirs, path, is_closed: AtomicBool::new(false) })
    }

    /// What other programs open.
    pub(crate) fn path(&self) -> &Path {
        &self.path
    }

    pub(crate) fn close(&self) {
        self.is_closed.store(true, Ordering::Release);
    }

    pub(crate) fn read(&self, bytes: &mut [u8]) -> io::Result<usize> {
        loop {
            match rustix::io::read(&self.ours, &mut *bytes) {
                Ok(count) => return Ok(count),
                Err(Errno::AGAIN) if !self.wait_for(PollFlags::IN)? => return Ok(0),
                Err(Errno::AGAIN | Errno::INTR) => {}
                Err(error) => return Err(error.into()),
            }
        }
    }

    pub(crate) fn write_all(&self, mut bytes: &[u8]) -> io::Result<()> {
        while !bytes.is_empty() {
            match rustix::io::write(&self.ours, bytes) {
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

    /// Waits for a moment, at most until something can be done; false once it is closed.
    fn wait_for(&self, flags: PollFlags) -> io::Result<bool> {
        match poll(&mut [PollFd::new(&self.ours, flags)], Some(&LOOK)) {
            Ok(_) | Err(Errno::INTR) => Ok(!self.is_closed.load(Ordering::Acquire)),
            Err(error) => Err(error.into()),
        }
    }
}
