//! The program on a terminal whose screen a test sees as a person does.
#![allow(dead_code, missing_docs)]

use std::fs::File;
use std::io::{Read as _, Write as _};
use std::num::NonZero;
use std::os::fd::{AsFd, OwnedFd};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fs::{Mode, OFlags};
use rustix::io::Errno;
use rustix::process::{Pid, PidfdFlags, Signal, kill_process, pidfd_open};
use rustix::pty::{OpenptFlags, openpt, ptsname, unlockpt};
use rustix::termios::{LocalModes, Winsize, tcgetattr, tcsetwinsize};

/// What takes longer does not come at all.
const DEADLINE: Duration = Duration::from_secs(60);

/// The program on a terminal.
pub struct OnScreen {
    child: Child,
    /// The side of the one who looks; none once it is closed.
    master: Option<File>,
    /// Keeps the terminal after the program.
    terminal: OwnedFd,
    name: String,
    screen: vt100::Parser,
}

impl OnScreen {
    /// Starts the program on a terminal of so many columns and rows.
    pub fn start(size: (u16, u16), arguments: &[&str]) -> Self {
        Self::spawn(size, &[&[env!("CARGO_BIN_EXE_ecan")][..], arguments].concat())
    }

    /// As [`start`](Self::start), as leader of a session of its own: it gets SIGHUP when the
    /// terminal goes away.
    pub fn start_leader(size: (u16, u16), arguments: &[&str]) -> Self {
        let leader = ["setsid", "--ctty", env!("CARGO_BIN_EXE_ecan")];
        Self::spawn(size, &[&leader[..], arguments].concat())
    }

    fn spawn(size: (u16, u16), line: &[&str]) -> Self {
        // No child of another test may keep it open.
        let flags = OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC;
        let master = openpt(flags).unwrap();
        unlockpt(&master).unwrap();
        let name = ptsname(&master, Vec::new()).unwrap().into_string().unwrap();
        let terminal = File::options().read(true).write(true).open(&name).unwrap();
        let end = || Stdio::from(terminal.try_clone().unwrap());
        tcsetwinsize(&master, winsize(size)).unwrap();
        let child = Command::new(line[0])
            .args(&line[1..])
            .env_remove("ECAN_ECRT")
            .env_remove("NO_COLOR")
            .env("TERM", "xterm-256color")
            .stdin(end())
            .stdout(end())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let (rows, columns) = cells(size);
        let screen = vt100::Parser::new(rows, columns, 0);
        Self { child, master: Some(master.into()), terminal: terminal.into(), name, screen }
    }

    /// What stands on the screen, without blanks at the ends of lines.
    pub fn screen(&self) -> String {
        self.screen.screen().contents()
    }

    /// Whether the program has a screen of its own, beside that of the shell.
    pub fn has_own_screen(&self) -> bool {
        self.screen.screen().alternate_screen()
    }

    /// Whether keys reach the program one by one.
    pub fn is_raw(&self) -> bool {
        !tcgetattr(&self.terminal).unwrap().local_modes.contains(LocalModes::ICANON)
    }

    /// Reads until the screen fits.
    pub fn wait_until(&mut self, what: &str, fits: impl Fn(&Self) -> bool) {
        let deadline = Instant::now() + DEADLINE;
        let mut buffer = [0; 4096];
        while !fits(self) {
            let master = self.master.as_mut().unwrap();
            assert!(wait_for(&*master, PollFlags::IN, deadline), "no {what}:\n{}", self.screen());
            let length = master.read(&mut buffer).unwrap();
            self.screen.process(&buffer[..length]);
        }
    }

    /// Reads until these words stand on the screen.
    pub fn wait_for(&mut self, words: &str) {
        self.wait_until(words, |it| it.screen().contains(words));
    }

    /// Types.
    pub fn press(&mut self, keys: &[u8]) {
        self.master.as_mut().unwrap().write_all(keys).unwrap();
    }

    /// Makes the terminal another size.
    pub fn resize(&mut self, size: (u16, u16)) {
        tcsetwinsize(self.master.as_ref().unwrap(), winsize(size)).unwrap();
        // What terminals make of what stood there differs: this one forgets it.
        let (rows, columns) = cells(size);
        let has_own_screen = self.has_own_screen();
        self.screen = vt100::Parser::new(rows, columns, 0);
        if has_own_screen {
            self.screen.process(b"\x1b[?1049h");
        }
        self.signal(Signal::WINCH);
    }

    /// Puts as much onto the terminal as it takes while nobody reads.
    pub fn fill(&self) {
        let flags = OFlags::WRONLY | OFlags::NONBLOCK | OFlags::NOCTTY | OFlags::CLOEXEC;
        let terminal = rustix::fs::open(&self.name, flags, Mode::empty()).unwrap();
        loop {
            match rustix::io::write(&terminal, &[b' '; 256]) {
                Ok(_) => {}
                Err(Errno::AGAIN) => break,
                Err(error) => panic!("{error}"),
            }
        }
    }

    /// Closes the terminal, as one who closes its window.
    pub fn close(&mut self) {
        self.master = None;
    }

    /// Sends a signal.
    pub fn signal(&self, signal: Signal) {
        kill_process(Pid::from_child(&self.child), signal).unwrap();
    }

    /// Waits for the end: exit status, and standard error.
    pub fn end(&mut self) -> (ExitStatus, String) {
        let process = pidfd_open(Pid::from_child(&self.child), PidfdFlags::empty()).unwrap();
        let is_over = wait_for(&process, PollFlags::IN, Instant::now() + DEADLINE);
        assert!(is_over, "it does not end:\n{}", self.screen());
        let mut errors = String::new();
        self.child.stderr.take().unwrap().read_to_string(&mut errors).unwrap();
        (self.child.wait().unwrap(), errors)
    }
}

impl Drop for OnScreen {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

fn winsize((columns, rows): (u16, u16)) -> Winsize {
    Winsize { ws_row: rows, ws_col: columns, ws_xpixel: 0, ws_ypixel: 0 }
}

/// Rows and columns, as the screen counts them.
fn cells((columns, rows): (u16, u16)) -> (NonZero<u16>, NonZero<u16>) {
    (NonZero::new(rows).unwrap(), NonZero::new(columns).unwrap())
}

/// Whether a descriptor is ready in time.
fn wait_for(descriptor: impl AsFd, flags: PollFlags, deadline: Instant) -> bool {
    let left = deadline.saturating_duration_since(Instant::now());
    let timeout = Timespec { tv_sec: left.as_secs() as i64, tv_nsec: left.subsec_nanos().into() };
    poll(&mut [PollFd::new(&descriptor, flags)], Some(&timeout)).unwrap() > 0
}
